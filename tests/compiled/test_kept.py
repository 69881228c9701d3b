"""A loop from the cache folder is the loop that was traced, and another one whenever anything is another."""

import json
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import kept
from k1607_pin.compiled.closed_loop import Setup
from k1607_pin.compiled.kernel import source
from k1607_pin.compiled.rollout import forget
from k1607_pin.compiled.tables import Table, Tables
from k1607_pin.control.cartesian import CartesianAdaptive
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.posture import along, hold
from k1607_pin.control.practice import Practice
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.simulation.integrators import runge_kutta_4, semi_implicit_euler
from k1607_pin.simulation.noise import with_noise
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.schedule import PayloadSchedule
from k1607_pin.simulation.wall import Wall


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("K1607_CACHE", str(tmp_path))
    return tmp_path


def setup_of(law, **more):
    plant = more.pop("plant", Plant(law.arm if hasattr(law, "arm") else law.law.arm))
    payloads = more.pop("payloads", [(0.1, k1607.Payload(4.5)), (0.2, k1607.Payload(0.0))])
    given = {"external": None, "from_rest": True, "step": semi_implicit_euler, "physics_step": 1e-3, "signals": {}}
    return Setup(plant=plant, controller=law, schedule=PayloadSchedule(payloads, 1.0), **{**given, **more})


@pytest.fixture
def no_tracing(monkeypatch):
    def begin():
        monkeypatch.setattr(kept, "traced", lambda *a: pytest.fail("traced anew"))

    return begin


def loops(arm, cartesian, q0):
    yield "cartesian", setup_of(cartesian(arm, posture=hold(q0, 5.0), practice=Practice(gravity=True))), ()
    yield "noisy", setup_of(with_noise(cartesian(arm), arm.n, 0.01, 1e-4, 1e-3)), ("controller.noise.seed",)
    start = arm.forward_kinematics(q0)
    wall = Wall(start.translation, (-1.0, 0, 0), [(0.0, 1e3), (0.2, 1e4, 0.3)], friction=0.3)
    yield "wall", setup_of(cartesian(arm), external=wall.external(arm), step=runge_kutta_4), ("external.wall.friction",)
    law = cartesian(arm)
    joints = joint_path(arm, law.path, q0, 1.0, law.rotation)
    gains, model = gains_from_mass(arm, q0, 20.0), model_from_mass(arm, q0, 20.0)
    yield "joint", setup_of(JointAdaptive(arm, joints, gains, model, 1e5, 1e5, 0.01)), ("controller.beta_1",)


@pytest.mark.parametrize("k", range(4))
def test_what_is_read_is_what_was_traced(arm, cartesian, q0, k, folder, no_tracing):
    name, setup, varied = list(loops(arm, cartesian, q0))[k]
    arguments = setup, varied, {"tau": ("max", "rms")}, ("q", "tau")
    first = kept.kept(*arguments)
    assert len(list(folder.glob("*.json"))) == 1, name
    no_tracing()
    again = kept.kept(*arguments)
    assert dict(again.programs) == dict(first.programs)
    assert source(again, 4) == source(first, 4)
    times = np.linspace(0, 1, 5)
    for ours, theirs in ((again.law_tables, first.law_tables), (again.physics_tables, first.physics_tables)):
        assert ours.noise == theirs.noise
        np.testing.assert_array_equal(ours.shared_values(times), theirs.shared_values(times))
    assert again.state.size == first.state.size
    for field in ("n", "parameters", "state_is_given", "metrics", "logged", "stages", "weights"):
        assert getattr(again, field) == getattr(first, field)


def test_rollouts_of_it_are_the_same_bytes(arm, law, q0, no_tracing):
    first = k1607.rollout(arm, law, q0, 0.1, log=("q",))
    forget()
    no_tracing()
    again = k1607.rollout(arm, law, q0, 0.1, log=("q",))
    assert first.identical(again)


def nudged(arm, change):
    model = arm.model
    change(model)
    return k1607.Arm(model, arm.tool_frame)


def others(arm, cartesian, q0):
    """What differs from the plain setup in one thing, by one unit of the last place where it is a number."""
    law = cartesian(arm)

    def up(x):
        return np.nextafter(x, np.inf)

    gains = law.gains
    for name, x in {
        "beta": replace(law, beta_1=up(law.beta_1)),
        "gains": replace(law, gains=gains._replace(K_p=up(gains.K_p))),
        "model": replace(law, model=replace(law.model, P=up(law.model.P))),
        "path": replace(law, path=replace(law.path, extent=up(law.path.extent))),
        "posture": replace(law, posture=hold(q0, 5.0)),
        "posture nearby": replace(law, posture=hold(up(q0), 5.0)),
        "posture along": replace(law, posture=along([0.0, 1.0], np.stack([q0, q0 + 1]), 5.0)),
        "posture along to nearby": replace(law, posture=along([0.0, 1.0], np.stack([q0, up(q0 + 1)]), 5.0)),
        "practice": replace(law, practice=Practice(sigma=0.5)),
    }.items():
        yield name, setup_of(x), {}

    def inertia(model):
        one = model.inertias[3]
        one.mass = float(up(one.mass))

    def limit(model):
        model.effortLimit = up(model.effortLimit)

    for name, change in {"inertia": inertia, "effort limit": limit}.items():
        yield name, setup_of(law, plant=Plant(nudged(arm, change))), {}
    yield "tool frame", setup_of(law, plant=Plant(k1607.Arm(arm.model, arm.model.frames[2].name))), {}
    yield "friction", setup_of(law, plant=Plant(arm, viscous=np.full(7, 1e-300))), {}
    yield "integrator", setup_of(law, step=runge_kutta_4), {}
    yield "physics step", setup_of(law, physics_step=float(up(1e-3))), {}
    yield "payload", setup_of(law, payloads=[(0.1, k1607.Payload(float(up(4.5)))), (0.2, k1607.Payload(0.0))]), {}
    yield "moving grip", setup_of(law, from_rest=False), {}
    yield "varied", setup_of(law), {"varied": ("controller.beta_1",)}
    yield "metrics", setup_of(law), {"metrics": {"tau": ("rms",)}}
    yield "logged", setup_of(law), {"logged": ("v",)}


def test_whatever_differs_gives_another_key(arm, cartesian, q0):
    rest = {"varied": (), "metrics": {"tau": ("max",)}, "logged": ("q",)}
    plain = setup_of(cartesian(arm))
    keys = {"plain": kept._key(plain, *rest.values())}
    assert kept._key(setup_of(cartesian(arm)), *rest.values()) == keys["plain"]  # made once more
    for name, setup, more in others(arm, cartesian, q0):
        keys[name] = kept._key(setup, *{**rest, **more}.values())
    assert len(set(keys.values())) == len(keys), keys


def test_the_package_s_own_code_belongs_to_the_key(tmp_path, monkeypatch):
    """A byte in any of its modules gives another one."""
    package = tmp_path / "package"
    (package / "sub").mkdir(parents=True)
    (package / "sub" / "one.py").write_text("x = 1\n")
    monkeypatch.setattr(kept, "files", lambda name: package)
    first = kept._code.__wrapped__()
    (package / "sub" / "one.py").write_text("x = 2\n")
    assert kept._code.__wrapped__() != first


@dataclass(frozen=True)
class Mine(CartesianAdaptive):
    """Somebody's own law, whose code may change."""


def test_a_controller_of_one_s_own_is_traced_every_time(arm, law, q0, folder):
    mine = Mine(**vars(law))
    k1607.rollout(arm, mine, q0, 0.05)
    k1607.rollout(arm, law, q0, 0.05, signals={"twice": lambda log: 2 * log["tau"]}, metrics={"twice": "max"})

    def my_step(acceleration, q, v, h):
        return semi_implicit_euler(acceleration, q, v, h)

    k1607.rollout(arm, law, q0, 0.05, step=my_step)
    assert not list(folder.glob("*.json"))
    k1607.rollout(arm, law, q0, 0.05)
    assert len(list(folder.glob("*.json"))) == 1


def damaged(content):
    rng = np.random.default_rng(0)
    for _ in range(40):
        at, bit = int(rng.integers(len(content))), 1 << int(rng.integers(8))
        yield content[:at] + bytes([content[at] ^ bit]) + content[at + 1 :]
    first, rest = content.split(b"\n", 1)
    yield from (b"", b"{", b"[]", b"null", content[:-1], content + b" ", rest, first + b"\n", b"\xff" + content)
    yield b"[" * 100_000


def test_what_is_damaged_is_told_and_made_again(arm, law, q0, folder, monkeypatch, caplog):
    """Each of them, whichever bit it is."""
    setup = setup_of(law)
    first = kept.kept(setup, (), {}, ())
    monkeypatch.setattr(kept, "_made", lambda *a: first)
    (file,) = folder.glob("*.json")
    whole = file.read_bytes()
    for content in damaged(whole):
        file.write_bytes(content)
        caplog.clear()
        assert kept.kept(setup, (), {}, ()) is first
        assert f"{file} is damaged, and made again" in caplog.text
        assert file.read_bytes() == whole


def test_another_loop_s_file_is_seen(arm, law, q0, folder):
    """A whole one, under this one's name."""
    setup = setup_of(law)
    first = kept.kept(setup, (), {}, ())
    (file,) = folder.glob("*.json")
    whole = file.read_bytes()
    kept.kept(setup_of(replace(law, beta_1=2.0)), (), {}, ())
    (other,) = set(folder.glob("*.json")) - {file}
    file.write_bytes(other.read_bytes())
    assert dict(kept.kept(setup, (), {}, ()).programs) == dict(first.programs)
    assert file.read_bytes() == whole


WRONG = {
    "an input of many": ("law", "input 1 0", "input 1 5000"),
    "an input before the first": ("law", "input 1 0", "input 1 -1"),
    "an input that is none": ("law", "input 1 0", "input 10 0"),
    "a noise that there is not": ("law", "input 1 0", "input 5 0"),
    "a later result": ("law", "\nmul 3 ", "\nmul 100000 "),
    "a result before the first": ("motion", "\nmul ", "\nmul -"),
    "no operation": ("motion", "\nmul ", "\nmull "),
    "an operation of one": ("motion", "\nmul ", "\nsin "),
    "one output less": ("law", "\noutput ", "\noutput\noutput "),
    "an output that is none": ("initial", "output ", "output 99999 "),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_every_index_is_looked_at(arm, law, q0, folder, wrong):
    """Whatever the checksum says: as a program of another size would be, read by this code."""
    setup = setup_of(law)
    first = kept.kept(setup, (), {}, ())
    (file,) = folder.glob("*.json")
    whole = file.read_bytes()
    found = kept._unsealed(file.name, whole)
    program, old, new = WRONG[wrong]
    listing = found["programs"][program]
    found["programs"][program] = listing.replace(old, new, 1) if old in listing else pytest.fail(f"no {old!r}")
    with pytest.raises(ValueError, match=rf"{program}: expected"):
        kept._read(found, setup, None)
    file.write_bytes(kept._sealed(file.name, found))
    assert dict(kept.kept(setup, (), {}, ()).programs) == dict(first.programs)
    assert file.read_bytes() == whole


@pytest.mark.parametrize("wrong", [{"n": 8}, {"weights": 5}, {"stages": 0}, {"metrics": [["tau", "sum", [7]]]}])
def test_sizes_are_the_setup_s(arm, law, q0, folder, wrong):
    setup = setup_of(law)
    kept.kept(setup, (), {}, ())
    (file,) = folder.glob("*.json")
    with pytest.raises(ValueError, match="closed loop: expected"):
        kept._read(kept._unsealed(file.name, file.read_bytes()) | wrong, setup, None)


def test_a_folder_that_cannot_be_is_no_obstacle(arm, law, monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("K1607_CACHE", str(blocked))
    assert kept.kept(setup_of(law), (), {}, ()).n == 7


def test_a_function_asked_at_another_time_is_kept_with_it(arm, law):
    t = ca.SX.sym("t")
    later = Table("controller.path", law.path, ca.Function("at", [t], [t + 0.25]), kept.Layout(law.path(0.0)), 0)
    setup = setup_of(law)
    written = json.loads(json.dumps(kept._tables_written(Tables((later,), ()), setup)))
    (read,) = kept._tables(written, setup).tables
    times = np.array([0.0, 0.1, 0.7])
    np.testing.assert_array_equal(read.values(times), later.values(times))
    assert (read.values(times) != replace(later, at=None).values(times)).any()


def test_functions_that_are_not_where_their_names_say_are_not_kept(arm, law):
    wrong = Table("controller.path", lambda t: 0.0, None, kept.Layout(0.0), 0)
    with pytest.raises(kept._UnknownError):
        kept._tables_written(Tables((wrong,), ()), setup_of(law))
