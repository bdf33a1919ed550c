"""``dockloop extremes``: whole scenes drawn at random over many decades, each with a verdict.

| file | what it holds |
|---|---|
| ``random_scenes.py`` | draws scenes, judges each, makes bad ones simpler |
| ``random_report.py`` | summary and page |
"""
