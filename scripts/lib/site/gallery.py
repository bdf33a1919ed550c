"""The gallery: a picture and a view of every shipped scene."""

from html import escape
from pathlib import Path

import dockloop as dl
from dockloop.base import paths
from dockloop.scene.mechanism import check_mechanism, draw
from dockloop.view.browser import find_browser
from dockloop.view.page import describe_outcome, find_events
from dockloop.view.pictures import write_stills

ACCURACY = 1e-2  # in a picture, a better one looks the same
CAMERA, SIZE = "oblique", (800, 500)
HEAD = """# Gallery

Every shipped scene, at first contact. A picture leads to the view of its docking: one page with the
motion in three dimensions, which needs no other file.
[Families of docking mechanisms](modelDescription/FAMILIES.md) explains the mechanisms,
[See the motion](scripts/README.md#see-the-motion) what a view shows.

"""
CARD = """<figure>
<a href="gallery/{name}.html"><img src="gallery/{picture}" alt="{name}"></a>
<figcaption><code>{name}</code> {title}: {outcome}.
<a href="gallery/{name}.html">View</a></figcaption>
</figure>
"""


def write_gallery(folder: Path) -> str:
    """Write pictures and views into a folder; returns the text of the page."""
    folder.mkdir(parents=True)
    cards = []
    for file in sorted(paths.SCENES.glob("*.toml")):
        print(f"gallery: {file.stem}", flush=True)
        cards.append(draw_scene(file.stem, folder))
    cards.sort(key=lambda card: ": captured" not in card)  # docking mechanisms first
    return f'{HEAD}<div class="gallery">\n{"".join(cards)}</div>\n'


def draw_scene(name: str, folder: Path) -> str:
    """Run a scene; write its view and its picture; returns what stands on the page."""
    run = dl.run(name, accuracy=ACCURACY)
    view = run.view(folder / f"{name}.html")
    if find_browser():
        picture = folder / f"{name}.png"
        events = {event["key"] for event in find_events(run)}
        write_stills(view, {picture: "contact" if "contact" in events else 0.0}, CAMERA, SIZE)
    else:
        picture = folder / f"{name}.svg"
        mechanism = dl.Scene(name).document["mechanism"]["name"]
        draw(mechanism, check_mechanism(mechanism), picture)
    title, outcome = escape(run.scene["title"]), escape(describe_outcome(run))
    return CARD.format(name=name, picture=picture.name, title=title, outcome=outcome)
