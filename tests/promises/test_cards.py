"""Every noun says on one screen what is inside, as text and as HTML, and its `dir` shows public names alone."""

from __future__ import annotations

import pickle
import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.card import MOST_LETTERS, MOST_LINES, WIDTH, Card, listed, setting, span

NOUNS = (
    "scene", "long scene", "recording", "long recording", "motion", "batch", "report", "long report", "certificates",
    "certificate", "linearisation", "grasp", "large grasp", "split", "coupling", "matrix coupling", "impedance",
    "point coupling", "touch", "large touch", "features", "no features", "session", "z-width", "loci", "sweep",
)  # fmt: skip


@pytest.fixture(scope="module")
def nouns() -> dict[str, Any]:
    scene, long = gx.load("paper-waving", {"coupling.internal.stiffness": 60.0}), gx.load("twenty-fingers")
    recording = gx.run(scene, duration=0.1)
    points = np.random.default_rng(0).normal(size=(40, 3))
    certificates = gx.certify(scene)
    gain = gx.Impedance(30.0, 0.1)
    split = gx.Grasp(points[:3]).split()
    return {
        "scene": scene,
        "long scene": long,
        "recording": recording,
        "long recording": gx.run(long, duration=0.02),
        "motion": recording.objects["object"],
        "batch": gx.run_batch("reference-1dof", {"object.mass": np.linspace(0.1, 0.2, 30)}, 0.05),
        "report": gx.check(scene),
        "long report": gx.check(long),
        "certificates": certificates,
        "certificate": certificates[0],
        "linearisation": scene.linearise(),
        "grasp": gx.Grasp(points[:3]),
        "large grasp": gx.Grasp(points),
        "split": split,
        "coupling": gx.Coupling(gain, gx.Impedance(70.0)),
        "matrix coupling": gx.Coupling(gx.Impedance(np.diag([1.0, 2.0, 3.0])), gx.Impedance(np.full(40, 7.0))),
        "impedance": gain,
        "point coupling": gx.PointCoupling(gain, gx.Impedance(70.0), 3, engine="interpreted"),
        "touch": gx.unilateral_force(np.eye(2) * 50.0, [0.001, 0.0, ], [[1.0], [-1.0]]),
        "large touch": gx.unilateral_force(np.eye(120) * 50.0, points.ravel(), points),
        "session": gx.open("reference-1dof", live=["coupling.internal.stiffness"]),
        "z-width": gx.passivity.z_width(0.2, 0.005, mass=0.15),
        "loci": gx.stability.loci("reference-1dof"),
        "sweep": gx.sweep("reference-1dof", {"object.mass": np.linspace(0.1, 0.2, 30)}, duration=0.05),
        "features": gx.protocols.Features(1, 2, peak_force=3.5, mass=0.2, workspace=(np.zeros(2), np.ones(2))),
        "no features": gx.protocols.Features(4, 3),
    }  # fmt: skip


class Reader(HTMLParser):
    """A reader that follows tags, and collects what is between them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag != "br":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_every_noun_is_there(nouns: dict[str, Any]) -> None:
    assert set(nouns) == set(NOUNS)


@pytest.mark.parametrize("name", NOUNS)
def test_a_noun_fits_a_screen_is_a_table_in_a_notebook_and_names_what_can_be_called(
    name: str, nouns: dict[str, Any]
) -> None:
    """Words of the last row that begin with a dot are attributes of the noun, those of `gx.` public names."""
    noun = nouns[name]
    text, html, names = repr(noun), noun._repr_html_(), dir(noun)
    assert 20 < len(text) < 2000 and text.count("\n") < 40
    assert max(map(len, text.splitlines()[1:]), default=0) <= WIDTH + 20
    assert " at 0x" not in text and str(noun) == text
    reader = Reader(html)
    assert html.startswith("<table>") and reader.open == []
    assert reader.texts[0].startswith(text.splitlines()[0][:WIDTH])
    assert names and not [each for each in names if each.startswith(("_", "model_"))]
    assert all(hasattr(noun, each) for each in names)
    for owner, attribute in re.findall(r"(?<![\w)\]])(gx)?\.([a-z]\w*)", noun._card().calls):
        assert hasattr(gx if owner else noun, attribute), attribute
    if name not in ("session", "point coupling"):  # which hold what is compiled here
        other = pickle.loads(pickle.dumps(noun))
        assert type(other) is type(noun) and repr(other) == text


def test_a_recording_says_what_it_is(nouns: dict[str, Any]) -> None:
    text = repr(nouns["recording"])
    for part in ("paper-waving", "0.1 s, 20 ticks of 5 ms", "thumb, forefinger", "objects", "faults      none",
                 "coupling.internal.stiffness = 60.0", " N\n", ".to_xarray()", ".plot()"):  # fmt: skip
        assert part in text, part
    assert "NOT complete" not in text
    recording = nouns["recording"]
    peaks = np.sqrt((recording.finger_force**2).sum(axis=2).max(axis=0))
    shares = 5.0 * recording.touching.sum(axis=0)  # of 20 ticks [%]
    assert f"  touching    {shares[0]:.0f} %, {shares[1]:.0f} % of the time\n" in text
    assert f"  peak force  {peaks[0]:.3g}, {peaks[1]:.3g} N\n" in text


def test_a_recording_names_faults_and_changes() -> None:
    with gx.open("reference-1dof", live=["coupling.internal.stiffness"]) as session:
        session.step(3)
        session.set("coupling.internal.stiffness", 60.0)
        session.step(3)
        recording = session.recording
    assert "tick 3: coupling.internal.stiffness = 60" in repr(recording)
    from graspfx.loop.columns import RunFault
    from graspfx.recording.header import Outcome

    broken = gx.Recording(recording.rows, recording.layout, recording.header,
                          Outcome(tuple(RunFault(k, f"<b>fault {k}") for k in range(5)), None, False))  # fmt: skip
    assert "tick 0: <b>fault 0" in repr(broken) and "and 2 more" in repr(broken) and "NOT complete" in repr(broken)
    assert "&lt;b&gt;fault 0" in broken._repr_html_() and "<b>" not in broken._repr_html_()


def test_texts_of_others_are_escaped() -> None:
    scene = gx.load("reference-1dof", {"title": "<script>alert('x')</script> & more"})
    assert "<script>" not in scene._repr_html_() and "&lt;script&gt;" in scene._repr_html_()
    assert "<script>" in repr(scene)


def test_a_card_ends_where_a_screen_does() -> None:
    card = Card("title", [("row", "\n".join(f"line {k} " + "x" * 300 for k in range(100)))], ".call()")
    assert len(str(card)) < MOST_LETTERS + 100 and str(card).count("\n") <= MOST_LINES and str(card).endswith("...")


def test_lists_and_spans() -> None:
    assert listed(range(3)) == "0, 1, 2" and listed(range(20), 4) == "0, 1, 2, ..., 19"
    assert span([1.0, 1.0], "N") == "1 N" and span([2.0, 1.0], "N") == "1 to 2 N" and span([], "N") == ""


def test_a_setting_that_is_a_list_of_tables_is_counted_not_printed() -> None:
    scene = gx.load("reference-1dof")
    times = np.linspace(0.0, 1.0, 50).tolist()
    path = {"kind": "path", "times": times, "positions": [[-0.025]] * 50}
    finger = {"device": {"name": "simulated", "mass": 0.1}, "hand": {"stiffness": 100.0, "motion": path}}
    fingers = [{"start": [x], **finger} for x in (-0.025, 0.025)]
    moved = scene.replace({"finger": fingers, "hand": [], "coupling.internal.stiffness": 60.0})
    recording = gx.run(moved, duration=0.05)
    for noun in (moved, recording):
        assert "finger = (2 entries), hand = [], coupling.internal.stiffness = 60.0" in str(noun)
    assert "peak force" in str(recording)
    [title] = {text.get_text() for text in recording.plot().figure.texts if "finger = " in text.get_text()}
    assert "finger = (2 entries)" in title.replace("\n", " ")


def test_short_lists_are_shown_and_long_ones_counted() -> None:
    assert setting("a.b", [0.1, 0.2]) == "a.b = [0.1, 0.2]"
    assert setting("friction", "stick") == "friction = 'stick'"
    assert setting("friction", "stick", str) == "friction = stick"
    assert setting("motion", {"times": [0.5] * 40}) == "motion = (1 entry)"
    assert setting("path", "x" * 200) == f"path = {'x' * 200!r}"
