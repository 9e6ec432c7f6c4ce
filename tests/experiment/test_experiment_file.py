"""Files of experiments: every fault at once with its line, and names that come close."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspfx.errors import InputError, SceneError, UnknownNameError
from graspfx.experiment.experiment_file import load, names, read
from graspfx.experiment.session_plan import cells
from tests.support.experiments import COMPARED, PLAIN, experiment

BROKEN = """name = "no-label"
scene = "reference-1dof"
order = "randon"
repetitions = 0

[question]
text = "Which?"
keys = { 12 = "first", 2 = "second" }

[[condition]]
name = "one"
set = { "coupling.internal.stifness" = 30.0 }
answr = "first"

[[condition]]
name = "one"
compare = { key = "coupling.external.stiffness", reference = -1.0 }
"""


def faults_of(text: str) -> list[tuple[int | None, str, str]]:
    with pytest.raises(SceneError) as caught:
        read(text, "test.toml")
    return [(fault.line, fault.key, fault.message) for fault in caught.value.faults]


def test_every_fault_at_once_with_its_line() -> None:
    faults = {(line, key.replace('"', "")): text for line, key, text in faults_of(BROKEN)}
    assert "letters and digits only" in faults[1, "name"]
    assert "expected 'fixed', 'random'" in faults[3, "order"]
    assert "no less than 1" in faults[4, "repetitions"]
    assert "one letter or digit" in faults[8, "question.keys"]
    assert "did you mean 'stiffness'" in faults[12, "condition.0.set.coupling.internal.stifness"]
    assert "did you mean 'answer'" in faults[13, "condition.0.answr"]
    assert "'one' is used twice" in faults[16, "condition.1.name"]
    assert "more than 0" in faults[17, "condition.1.compare.reference"]
    assert "[staircase]" in faults[17, "condition.1.compare"]
    assert len(faults) == 9


@pytest.mark.parametrize(
    ("text", "before", "after", "key", "message"),
    [
        (PLAIN, '"reference-1dof"', '"reference-1d"', "scene", "did you mean 'reference-1dof'"),
        (PLAIN, 'answer = "soft"', 'answer = "sort"', "condition.0.answer", "did you mean 'soft'"),
        (PLAIN, '40.0 }', '-4.0 }', 'condition.0.set."coupling.internal.stiffness"', "no less than 0"),
        (PLAIN, "40.0 }", '"a" }', 'condition.0.set."coupling.internal.stiffness"', "a number"),
        (PLAIN, '"reference-1dof"', '"../other.toml"', "scene", "there is no file"),
        (PLAIN, "repetitions = 2", "repetitions = 9000", "repetitions", "at most 10000 trials"),
        (COMPARED, 'keys = { 1 = "first", 2 = "second" }', 'keys = { 1 = "first" }', "question.keys", "'second'"),
        (COMPARED, "external = 0.3", "extenal = 0.3", "observer.threshold.extenal", "did you mean 'external'"),
        (COMPARED, "least = 0.05, most = 0.5, count = 12 }\nthreshold", "least = 0.5, most = 0.05 }\nthreshold",
         "staircase.increments.most", "more than `least`"),
        (COMPARED, "reference = 50.0 }", "reference = 50.0, increments = [0.1] }\nanswer = 'first'",
         "condition.0.answer", "omit the answer"),
        (COMPARED, '"coupling.internal.stiffness", ref', '"coupling.internal.stifness", ref',
         "condition.0.compare.key", "did you mean 'stiffness'"),
        (COMPARED, 'kind = "psychometric"', 'kind = "psychometrick"', "observer.kind", "expected 'psychometric'"),
    ],
)  # fmt: skip
def test_faults(text: str, before: str, after: str, key: str, message: str) -> None:
    assert before in text
    faults = faults_of(text.replace(before, after, 1))
    assert [each[1] for each in faults] == [key], faults
    assert message in faults[0][2], faults


def test_a_staircase_and_comparisons_need_one_another() -> None:
    bare = COMPARED[: COMPARED.index("[staircase]")]
    assert [each[1] for each in faults_of(bare)] == ["condition.0.compare", "condition.1.compare"]
    lonely = PLAIN + "[staircase]\nincrements = { least = 0.1, most = 1.0 }\nthreshold = { least = 0.1, most = 1.0 }\n"
    assert [each[1] for each in faults_of(lonely)] == ["staircase"]


def test_what_is_no_experiment(tmp_path: Path) -> None:
    assert "stiffness-jnd" in names()
    with pytest.raises(UnknownNameError, match="did you mean 'stiffness-jnd'"):
        load("stifness-jnd")
    with pytest.raises(InputError, match=r"none\.toml"):
        load(tmp_path / "none.toml")
    (tmp_path / "a.toml").write_text("name = [\n", encoding="utf-8")
    with pytest.raises(SceneError, match="not TOML"):
        load(tmp_path / "a.toml")


def test_a_scene_outside_of_the_folder_is_used_with_trust_alone(tmp_path: Path) -> None:
    home = tmp_path / "study"
    home.mkdir()
    (tmp_path / "other.toml").write_text("", encoding="utf-8")
    path = home / "mine.toml"
    path.write_text(PLAIN.replace('"reference-1dof"', '"../other.toml"'), encoding="utf-8")
    with pytest.raises(SceneError, match="is outside this file's folder"):
        load(path)
    device = '"finger.0.device" = { name = "mine.py" }'
    path.write_text(PLAIN.replace('"coupling.internal.stiffness" = 40.0', device), encoding="utf-8")
    with pytest.raises(SceneError, match="names a file; add --trust to use it"):
        load(path)


def test_factors_are_crossed() -> None:
    text = (
        PLAIN[: PLAIN.index("[[condition]]")]
        + """
[[factor]]
name = "internal"
key = "coupling.internal.stiffness"
levels = [30.0, 50.0, 70.0]

[factor.level]

[[factor]]
name = "period"
[factor.level.slow]
period = 0.01
[factor.level.fast]
period = 0.002
"""
    )
    design = cells(experiment(text).table)
    assert [dict(cell.levels) for cell in design][:3] == [
        {"internal": 30.0, "period": "slow"},
        {"internal": 30.0, "period": "fast"},
        {"internal": 50.0, "period": "slow"},
    ]
    assert len(design) == 6
    assert design[-1].values == {"engine": "interpreted", "coupling.internal.stiffness": 70.0, "period": 0.002}


def test_a_comparison_puts_the_larger_value_where_it_is_to_be() -> None:
    cell = cells(experiment(COMPARED).table)[0]
    key = "coupling.internal.stiffness"
    for place, answer in ((0, "first"), (1, "second")):
        trial = cell.trial(1, 1, place, 0.1)
        values = [each[key] for each in trial.intervals]
        assert trial.answer == answer
        assert (values[place], values[1 - place]) == (50.0 * 1.1, 50.0)
