"""The default scene with vehicles of 400 and 800 kg, which rebound where heavy ones press."""

from pathlib import Path

from dockloop.base import paths

LINES = {  # of the scene that differ
    "mass = 25e3": "mass = 400",
    "inertia = [60.5e3, 132e3, 132e3,": "inertia = [80, 90, 90,",
    "interface_position = [3.72,": "interface_position = [0.22,",
    "mass = 350e3": "mass = 800",
    "inertia = [4e7, 8e7, 8e7,": "inertia = [200, 250, 250,",
    "interface_position = [-15,": "interface_position = [-1,",
}


def write_light_scene(folder: Path) -> Path:
    """Write the scene into a folder; returns its file."""
    scene = (paths.SCENES / "idss_25t_350t.toml").read_text(encoding="utf-8")
    for old, new in LINES.items():
        assert old in scene, old
        scene = scene.replace(old, new, 1)
    file = folder / "light.toml"
    file.write_text(scene, encoding="utf-8")
    return file
