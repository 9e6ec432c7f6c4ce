"""The bridge of rates in the tick: energy, predictions, lost and late samples, silence, and what no host may send."""

from functools import partial

import numpy as np
import pytest
from matplotlib.text import Text

import graspfx as gx
from graspfx.errors import DeviceError, InputError, SceneError
from tests.support.hosted import Line, hosted, hosted_scene, raw, spring


def moving(i):
    """A hand that moves back and forth, and opens and closes as its fingers go by different ways."""
    motion = {"kind": "sine", "amplitude": 0.01 - 0.015 * i, "frequency": 1.3, "axis": "x"}
    return {"stiffness": 200.0, "damping": 1.0, "motion": motion}


CHAIN = {"soft_start": 0.0, "force": 5.0}
ENGINES = ["interpreted", "compiled"]


def late_run(scene, *, delay, jitter=0, lost=0.0, every=10, push=300.0, squeeze=300.0, ticks=3000, seed=0):
    """A linear host whose samples come late and of which some never come."""
    rng = np.random.default_rng(seed)
    with hosted(scene) as (session, link):
        line, rest = Line(link), link.read().position
        for number in range(1, ticks // every):
            for _ in range(every):
                line.deliver(session.tick)
                session.step()
            read = link.read()
            external, internal = spring(read, rest, push, squeeze)
            if rng.uniform() >= lost:
                due = session.tick + delay + int(rng.integers(0, jitter + 1))
                sample = (number, external, internal, read.position, 0.001 * session.tick)
                line.send(due, partial(raw, link, *sample))
        host = session.servo.host.state
        return session.recording, session.fault, {
            "lost": host.lost, "late": host.late,
            "push": host.push_tank.given, "squeeze": host.squeeze_tank.given,
            "levels": (host.push_tank.level, host.squeeze_tank.level),
        }  # fmt: skip


def energies(recording):
    """Work of the displayed forces on the operator so far, and what was exchanged, by the recording alone [J]."""
    work = (recording.displayed_force[:-1] * np.diff(recording.true_position, axis=0)).sum(axis=(1, 2))
    return np.cumsum(work), np.abs(work).sum()


@pytest.mark.parametrize("predict", ["hold", "linear", "model"])
@pytest.mark.parametrize("delay", [5, 20, 50])
def test_no_energy_is_created(delay, predict):
    """At any time the operator has got no more than the tanks had at first, whatever delay, losses and jitter do."""
    tank = 0.02
    host = {"predict": predict, "push_stiffness": 300.0, "squeeze_stiffness": 300.0, "tank": tank, "silence": 1.0}
    scene = hosted_scene(host, hand=moving, safety=CHAIN)
    recording, fault, state = late_run(scene, delay=delay, jitter=20, lost=0.3)
    given, exchanged = energies(recording)
    assert fault is None
    assert exchanged > 0.01
    assert given.max() <= 2.0 * tank + 1e-9 * exchanged
    assert state["push"] + state["squeeze"] == pytest.approx(given[-1], abs=1e-9 * exchanged)
    for name in ("push", "squeeze"):  # each port by itself
        assert state[name] <= tank + 1e-9 * exchanged
    assert min(state["levels"]) >= 0.0
    assert state["lost"] > 0


@pytest.mark.parametrize("delay", [20, 50])
def test_without_the_tanks_energy_is_created(delay):
    host = {"tank": 0.0, "silence": 1.0, "speed": 100.0, "largest": 1e9}
    recording, _, _ = late_run(hosted_scene(host, hand=moving, safety=CHAIN), delay=delay, jitter=20, lost=0.3)
    assert energies(recording)[0].max() > 0.05


def test_a_squeeze_that_takes_energy_leaves_the_push_its_own():
    """The squeeze's environment gives energy away; its tank ends empty, and the push's stays as it is."""
    host = {"tank": 0.01, "silence": 1.0}
    _, fault, state = late_run(hosted_scene(host, hand=moving), delay=50, push=0.0, squeeze=600.0)
    assert fault is None
    assert state["levels"][0] == 0.01  # no push, no work
    assert state["squeeze"] <= 0.01 + 1e-15


def exchange(session, link, number, external, internal=None, time=None, ticks=10, origin=None):
    n, d = link.fingers, link.dimensions
    at = link.read().position if origin is None else origin
    internal = np.zeros((n, d)) if internal is None else internal
    raw(link, number, np.broadcast_to(external, (n, d)), internal, at, 0.01 * number if time is None else time)
    session.step(ticks)


def test_hold_keeps_a_sample_and_linear_follows_its_slope_for_one_interval():
    felt = {}
    for method in ("hold", "linear"):
        scene = hosted_scene({"predict": method})
        with hosted(scene) as (session, link):
            exchange(session, link, 1, [0.1, 0.0, 0.0])
            exchange(session, link, 2, [0.2, 0.0, 0.0], ticks=30)
            felt[method] = session.recording.displayed_force[11:, 0, 0]
    assert np.allclose(felt["hold"], 0.2, rtol=0, atol=1e-12)
    ahead = 0.2 + 0.1 * np.minimum(np.arange(30) / 10.0, 1.0)  # 10 N/s, for 10 ms at most
    assert np.allclose(felt["linear"], ahead, rtol=0, atol=1e-12)


def test_a_model_follows_the_operator_between_samples():
    """f = f_sample - K_push P dx - K_squeeze (I - P) dx, dx from where the operator was for the sample."""
    scene = hosted_scene({"predict": "model", "push_stiffness": 40.0, "squeeze_stiffness": 90.0}, hand=moving)
    with hosted(scene) as (session, link):
        origin = link.read().position
        external, internal = np.array([[0.3, 0.0, 0.0]] * 2), np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]])
        raw(link, 1, external, internal, origin, 0.01)
        session.step(90)
        recording = session.recording
    for k in range(5, 91):
        now = recording.finger_position[k]
        outer, inner = gx.divide(gx.Grasp(now), now - origin)
        wanted = external + internal - 40.0 * outer - 90.0 * inner
        assert np.allclose(recording.displayed_force[k], wanted, rtol=0, atol=1e-12)


def test_lost_and_late_samples_are_counted_and_late_ones_left_out():
    scene = hosted_scene()
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [0.1, 0.0, 0.0])
        exchange(session, link, 5, [0.2, 0.0, 0.0])
        exchange(session, link, 3, [0.9, 0.0, 0.0])
        read = link.read()
        assert (read.lost, read.late) == (3, 1)
        assert np.allclose(read.force, [[0.2, 0.0, 0.0]] * 2)


def test_a_sample_that_is_half_written_is_not_taken():
    scene = hosted_scene()
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [0.1, 0.0, 0.0])
        words = np.asarray(link._words)
        slot = words[int(words[6]) + 2 * int(words[7]) :]
        slot[:4], words[12] = [2.0, 0.02, 0.0, 7.0], 2.0
        session.step(10)
        assert np.allclose(link.read().force, [[0.1, 0.0, 0.0]] * 2)
        exchange(session, link, 2, [0.3, 0.0, 0.0])
        assert np.allclose(link.read().force, [[0.3, 0.0, 0.0]] * 2)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_silent_host_fades_to_zero_and_is_named(engine):
    scene = hosted_scene({"silence": 0.05}, engine=engine)
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [1.0, 0.0, 0.0], ticks=45)
        assert not str(session.fault or "")
        session.step(60)
        recording, fault = session.recording, session.fault
        with pytest.raises(DeviceError, match="fault"):
            link.read()
    force = recording.displayed_force[:, 0, 0]
    assert fault is not None
    assert "host.silence" in str(fault)
    assert force[50] == pytest.approx(1.0)  # before the silence is over
    assert np.abs(np.diff(force[5:])).max() <= 0.05 + 1e-12  # 20 ms from 1 N to 0
    assert not force[75:].any()


def test_a_host_that_is_back_in_time_is_felt_again():
    scene = hosted_scene({"silence": 0.05})
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [1.0, 0.0, 0.0], ticks=60)
        assert session.recording.displayed_force[-1, 0, 0] < 0.7
        for number in range(2, 8):
            exchange(session, link, number, [1.0, 0.0, 0.0])
        assert session.fault is None
        assert session.recording.displayed_force[-1, 0, 0] == pytest.approx(1.0)


def test_soft_start_begins_with_the_hosts_first_sample():
    """A host that comes late is felt gradually: 3 x^2 - 2 x^3 of its force, x = ticks since its first sample/500."""
    scene = hosted_scene(safety={"soft_start": 0.5, "force": 1e3})
    with hosted(scene) as (session, link):
        session.step(999)
        for number in range(1, 61):
            exchange(session, link, number, [1.0, 0.0, 0.0])
        force = session.recording.displayed_force[1000:, 0, 0]
    x = np.minimum(np.arange(1, 601) / 500.0, 1.0)
    assert np.allclose(force, x * x * (3.0 - 2.0 * x), rtol=0, atol=1e-12)


def test_a_host_that_overwrites_the_header_is_not_followed_astray():
    """Sizes and places of the slots are the loop's own: a wild host writes at most its own forces."""
    with hosted(hosted_scene()) as (session, link):
        exchange(session, link, 1, [0.1, 0.0, 0.0])
        np.asarray(link._words)[2:10] = 1e12
        session.step(10)
        assert session.fault is None
        assert np.allclose(session.recording.displayed_force[-1], [[0.1, 0.0, 0.0]] * 2)


def test_a_loop_that_waits_for_its_host_shows_nothing():
    with gx.open(hosted_scene({"silence": 0.01})) as session:
        session.step(200)
        assert session.fault is None
        assert not session.recording.displayed_force.any()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("force", "words"), [(np.nan, "not finite"), (np.inf, "not finite"), (1e6, "host.largest"), (-1e6, "host.largest")]
)
def test_what_no_host_can_mean_is_zero_force_in_the_same_tick(force, words, engine):
    with hosted(hosted_scene(engine=engine)) as (session, link):
        exchange(session, link, 1, [0.5, 0.0, 0.0])
        origin = link.read().position
        exchange(session, link, 2, [force, 0.0, 0.0], origin=origin)
        assert words in str(session.fault)
        assert session.fault is not None
        assert session.fault.tick == 11
        assert not session.recording.displayed_force[11:].any()
        assert np.isfinite(session.recording.displayed_force).all()


def test_a_host_that_ends_fades():
    scene = hosted_scene()
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [0.5, 0.0, 0.0])
        link._number = 1
        link.stop()
        session.step(40)
        assert "host has ended" in str(session.fault)
        assert np.abs(np.diff(session.recording.displayed_force[5:, 0, 0])).max() <= 0.5 * 0.05 + 1e-12


def test_squeeze_gives_way_before_push_at_a_fingers_limit():
    """|e + l s| = L with e along x and s across: l = sqrt(L^2 - e^2)/|s|, and the push is whole."""
    scene = hosted_scene(safety={"soft_start": 0.0, "force": 1.0}, hand={"stiffness": 2000.0, "damping": 5.0})
    with hosted(scene) as (session, link):
        exchange(session, link, 1, [0.6, 0.0, 0.0], np.array([[0.0, 3.0, 0.0], [0.0, -3.0, 0.0]]))
        assert np.allclose(link.read().force, [[0.6, 0.8, 0.0], [0.6, -0.8, 0.0]], rtol=0, atol=1e-12)
        exchange(session, link, 2, [4.0, 0.0, 0.0], np.array([[0.0, 3.0, 0.0], [0.0, -3.0, 0.0]]))
        assert np.allclose(link.read().force, [[1.0, 0.0, 0.0]] * 2, rtol=0, atol=1e-12)


def test_interpreted_and_compiled_ticks_have_the_same_bits():
    runs = []
    for engine in ENGINES:
        scene = hosted_scene({"predict": "model", "push_stiffness": 50.0, "tank": 0.003}, hand=moving, engine=engine)
        runs.append(late_run(scene, delay=20, jitter=5, lost=0.2, ticks=400)[0])
    assert np.array_equal(runs[0].displayed_force, runs[1].displayed_force)
    assert runs[0].displayed_force.any()


def test_a_second_loop_of_a_name_is_refused_and_a_dead_ones_name_is_free():
    scene = hosted_scene({"name": "test-twice"})
    with hosted(scene) as (session, _), gx.open(hosted_scene({"name": "test-twice"})) as other:
        session.step()
        with pytest.raises(DeviceError, match="another run has this name"):
            other.step()
    with hosted(scene):
        pass
    with pytest.raises(DeviceError, match="start its scene first"):
        gx.Feedback().connect("test-twice", timeout=0.0)


def test_what_needs_the_object_is_refused():
    scene = hosted_scene()
    assert gx.check(scene).verdict.startswith("not judged: host")
    values = {"host.silence": [0.1, 0.2]}
    with hosted(scene) as (session, _):
        session.step(5)
    for refused in (
        lambda: gx.run(scene), lambda: gx.run_batch(scene, values), lambda: gx.certify(scene),
        lambda: gx.replay(session.recording),
    ):  # fmt: skip
        with pytest.raises(InputError, match="host"):
            refused()
    with pytest.raises(SceneError, match="simulates the object"):
        hosted_scene(object={"mass": 1.0, "viscosity": 0.0, "rotational_viscosity": 0.0})
    assert gx.Scene(**scene.to_dict()) == scene


def test_the_plan_is_the_hosts():
    """What a tick runs in a host's scene stands in the plan, and nothing of the law that it has not."""
    rows = {row.step: row.runs for row in gx.check(hosted_scene()).plan}
    assert rows["host"]
    assert rows["tanks"]
    assert not rows["predict between samples"]
    assert rows["safety"]
    assert not {"impedance", "split", "contact points", "reaction"} & rows.keys()
    off = {row.step: row.runs for row in gx.check(hosted_scene({"tank": 0.0, "predict": "linear"})).plan}
    assert not off["tanks"]
    assert off["predict between samples"]


def test_a_recording_shows_no_object_that_its_host_simulates():
    """Its motion and contacts are the host's: lengths relative to them would be those of a stand-in at the origin."""
    with hosted(hosted_scene()) as (session, link):
        exchange(session, link, 1, [1.0, 0.0, 0.0], ticks=40)
        recording = session.recording
    summary = recording.summary()
    for key in ("internal_deformation_mean", "internal_deformation_peak", "tracking_error", "object_vibration"):
        assert summary[key] is None
    assert max(summary["peak_force"]) > 0.9
    figure = recording.plot().figure
    texts = [text.get_text() for text in figure.findobj(Text)]
    assert not any(word in text for text in texts for word in ("object", "k_p", "displacement"))
    assert any("force [N]" in text for text in texts)
