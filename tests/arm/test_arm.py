import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.description import description
from k1607_pin.description.dh import table_1
from k1607_pin.description.urdf import to_urdf
from k1607_pin.kinematics import product

EPS = np.finfo(float).eps
SEED = st.integers(0, 2**32 - 1)


def state(arm, seed):
    """q, v, a of a size that torques of some hundred N m follow from."""
    rng = np.random.default_rng(seed)
    return arm.random_configuration(rng), rng.normal(size=arm.n), rng.normal(size=arm.n)


def tool(arm, model):
    return next(i for i, f in enumerate(model.frames) if f.name == arm.tool_frame and f.type == pin.BODY)


METHODS = {
    "forward_kinematics": lambda arm, q, v, a: arm.forward_kinematics(q).homogeneous,
    "frames": lambda arm, q, v, a: np.stack([T.homogeneous for T in arm.frames(q)]),
    "jacobian": lambda arm, q, v, a: arm.jacobian(q),
    "mass_matrix": lambda arm, q, v, a: arm.mass_matrix(q),
    "gravity_torque": lambda arm, q, v, a: arm.gravity_torque(q),
    "bias_torque": lambda arm, q, v, a: arm.bias_torque(q, v),
    "coriolis_matrix": lambda arm, q, v, a: arm.coriolis_matrix(q, v),
    "forward_dynamics": lambda arm, q, v, a: arm.forward_dynamics(q, v, a),
    "inverse_dynamics": lambda arm, q, v, a: arm.inverse_dynamics(q, v, a),
}


class TestAgainstBarePinocchio:
    """By other algorithms of Pinocchio than the ones that `Arm` calls."""

    @given(seed=SEED)
    def test_kinematics(self, arm, seed):
        q, *_ = state(arm, seed)
        model = arm.model
        workspace = model.createData()
        pin.computeJointJacobians(model, workspace, q)
        pin.updateFramePlacements(model, workspace)
        frame = tool(arm, model)
        T = workspace.oMf[frame].homogeneous
        np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, T, rtol=0, atol=1e-14)
        J = pin.getFrameJacobian(model, workspace, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(arm.jacobian(q), J, rtol=0, atol=1e-14)
        for found, expected in zip(arm.frames(q), list(workspace.oMi)[1:], strict=True):
            np.testing.assert_allclose(found.homogeneous, expected.homogeneous, rtol=0, atol=1e-14)

    @given(seed=SEED)
    def test_mass_matrix_column_by_column(self, arm, seed):
        """Each column is the torque that accelerates one joint alone, at rest and without gravity."""
        q, *_ = state(arm, seed)
        model = arm.model
        model.gravity = pin.Motion.Zero()
        workspace, zero = model.createData(), np.zeros(arm.n)
        M = np.stack([pin.rnea(model, workspace, q, zero, unit).copy() for unit in np.eye(arm.n)], axis=1)
        np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=0, atol=1e-13 * np.abs(M).max())

    @given(seed=SEED)
    def test_gravity_is_the_gradient_of_the_potential(self, arm, seed):
        q, *_ = state(arm, seed)
        model = arm.model
        workspace = model.createData()
        h = 1e-5
        energy = [
            pin.computePotentialEnergy(model, workspace, q + s) - pin.computePotentialEnergy(model, workspace, q - s)
            for s in h * np.eye(arm.n)
        ]
        # third derivative of the potential below 2000 J; rounding of some 1000 J over h
        tolerance = 2000 * h * h / 6 + 1000 * 8 * EPS / h
        np.testing.assert_allclose(arm.gravity_torque(q), np.array(energy) / (2 * h), rtol=0, atol=tolerance)

    @given(seed=SEED)
    def test_torques(self, arm, seed):
        q, v, a = state(arm, seed)
        model = arm.model
        workspace, zero = model.createData(), np.zeros(arm.n)
        bias, gravity = pin.rnea(model, workspace, q, v, zero).copy(), pin.rnea(model, workspace, q, zero, zero).copy()
        atol = 1e-12 * max(1, np.abs(bias).max())
        np.testing.assert_allclose(arm.bias_torque(q, v), bias, rtol=0, atol=atol)
        np.testing.assert_allclose(arm.gravity_torque(q), gravity, rtol=0, atol=atol)
        np.testing.assert_allclose(arm.coriolis_matrix(q, v) @ v, bias - gravity, rtol=0, atol=atol)
        np.testing.assert_allclose(arm.inverse_dynamics(q, v, a), arm.mass_matrix(q) @ a + bias, rtol=0, atol=10 * atol)


class TestDynamics:
    @given(seed=SEED)
    def test_mass_matrix_is_symmetric_positive_definite(self, arm, seed):
        q, v, _ = state(arm, seed)
        M = arm.mass_matrix(q)
        np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-13)
        assert np.linalg.eigvalsh(M)[0] > 0
        assert v @ M @ v > 0

    @given(seed=SEED)
    def test_acceleration_and_torque_are_inverse(self, arm, seed):
        """ABA after RNEA, and RNEA after ABA; the condition of M, up to 1e5 for the Panda, is what it costs."""
        q, v, a = state(arm, seed)
        condition = np.linalg.cond(arm.mass_matrix(q))
        assert condition < 1e6
        tau = arm.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(arm.forward_dynamics(q, v, tau), a, rtol=0, atol=64 * EPS * condition * 10)
        tau = 10 * a
        found = arm.forward_dynamics(q, v, tau)
        atol = 64 * EPS * condition * (1 + np.abs(found).max())
        np.testing.assert_allclose(arm.inverse_dynamics(q, v, found), tau, rtol=0, atol=atol)
        np.testing.assert_allclose(arm.mass_matrix(q) @ found + arm.bias_torque(q, v), tau, rtol=0, atol=atol)

    @given(seed=SEED)
    def test_coriolis_matrix_takes_half_of_the_mass_matrix_rate(self, arm, seed):
        """M_dot = C + C^T, that is M_dot - 2 C skew, with M_dot by central differences along v."""
        q, v, _ = state(arm, seed)
        C = arm.coriolis_matrix(q, v)
        h = 1e-5
        M_dot = (arm.mass_matrix(q + h * v) - arm.mass_matrix(q - h * v)) / (2 * h)
        # M varies like sin(2 q) of its own size: third derivative 8 |v|^3 |M|
        size = np.abs(arm.mass_matrix(q)).max() + 10
        tolerance = size * (8 * np.linalg.norm(v, 1) ** 3 * h * h / 6 + 32 * EPS / h)
        np.testing.assert_allclose(M_dot, C + C.T, rtol=0, atol=tolerance)

    @given(seed=SEED)
    def test_energy_identity(self, arm, seed):
        """1/2 d/dt (v^T M v) = v^T (tau - g), with the acceleration from forward dynamics."""
        q, v, a = state(arm, seed)
        tau = 20 * a
        acceleration = arm.forward_dynamics(q, v, tau)
        C = arm.coriolis_matrix(q, v)
        rate = v @ arm.mass_matrix(q) @ acceleration + v @ (C + C.T) @ v / 2
        power = v @ (tau - arm.gravity_torque(q))
        size = np.linalg.norm(v) * (np.linalg.norm(tau) + np.linalg.norm(arm.bias_torque(q, v)) + 1)
        condition = np.linalg.cond(arm.mass_matrix(q))
        assert rate == pytest.approx(power, abs=16 * EPS * condition * size)

    @given(seed=SEED)
    def test_at_rest_only_gravity_is_left(self, arm, seed):
        q, *_ = state(arm, seed)
        zero, g = np.zeros(arm.n), arm.gravity_torque(q)
        np.testing.assert_allclose(arm.bias_torque(q, zero), g, rtol=0, atol=1e-12)
        np.testing.assert_allclose(arm.inverse_dynamics(q, zero, zero), g, rtol=0, atol=1e-12)
        np.testing.assert_allclose(arm.forward_dynamics(q, zero, g), 0, atol=1e-8)
        assert not arm.coriolis_matrix(q, zero).any()

    @given(seed=SEED)
    def test_velocity_terms_are_quadratic(self, arm, seed):
        q, v, _ = state(arm, seed)
        g = arm.gravity_torque(q)
        once, twice = arm.bias_torque(q, v) - g, arm.bias_torque(q, 2 * v) - g
        np.testing.assert_allclose(twice, 4 * once, rtol=0, atol=1e-12 * max(1, np.abs(g).max()))

    def test_a_forward_simulation_conserves_energy(self, arm):
        """Falling without torque: a Runge-Kutta step of 1 ms loses less than a millionth of what has turned to motion."""
        model = arm.model
        workspace = model.createData()
        zero = np.zeros(arm.n)

        def energy(q, v):
            return v @ arm.mass_matrix(q) @ v / 2 + pin.computePotentialEnergy(model, workspace, q)

        def rate(q, v):
            return v, arm.forward_dynamics(q, v, zero)

        q, v, h = arm.random_configuration(np.random.default_rng(6)), np.zeros(arm.n), 1e-3
        start = energy(q, v)
        for _ in range(200):
            k1 = rate(q, v)
            k2 = rate(q + h / 2 * k1[0], v + h / 2 * k1[1])
            k3 = rate(q + h / 2 * k2[0], v + h / 2 * k2[1])
            k4 = rate(q + h * k3[0], v + h * k3[1])
            q = q + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
            v = v + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        kinetic = v @ arm.mass_matrix(q) @ v / 2
        assert kinetic > 0.1
        assert abs(energy(q, v) - start) < 1e-6 * kinetic


class TestBatches:
    @pytest.mark.parametrize("shape", [(1,), (5,), (2, 3), (0,)])
    def test_equal_single_calls_bit_for_bit(self, arm, shape):
        q = arm.random_configuration(np.random.default_rng(3), shape)
        T, J = arm.forward_kinematics(q), arm.jacobian(q)
        assert T.shape == (*shape, 4, 4)
        assert J.shape == (*shape, 6, arm.n)
        for index in np.ndindex(shape):
            np.testing.assert_array_equal(T[index], arm.forward_kinematics(q[index]).homogeneous)
            np.testing.assert_array_equal(J[index], arm.jacobian(q[index]))

    def test_memory_layout_does_not_matter(self, arm):
        """Strided, reversed, transposed, read-only and byte-swapped arrays hold the same numbers."""
        rng = np.random.default_rng(4)
        Q = arm.random_configuration(rng, 6)
        frozen = Q.copy()
        frozen.setflags(write=False)
        layouts = [np.asfortranarray(Q), np.repeat(Q, 2, axis=0)[::2], Q[::-1][::-1], frozen, Q.astype(">f8")]
        for same in layouts:
            np.testing.assert_array_equal(arm.jacobian(same), arm.jacobian(Q))
            np.testing.assert_array_equal(arm.forward_kinematics(same), arm.forward_kinematics(Q))
        q, v, a = Q[:3]
        expected = [method(arm, q, v, a) for method in METHODS.values()]
        for same in layouts:
            for method, value in zip(METHODS.values(), expected, strict=True):
                np.testing.assert_array_equal(method(arm, *same[:3]), value)
        for strided in (np.repeat(Q, 3, axis=1)[:3, ::3], Q[:3, ::-1].copy()[:, ::-1], np.asfortranarray(Q)[:3]):
            for method, value in zip(METHODS.values(), expected, strict=True):
                np.testing.assert_array_equal(method(arm, *strided), value)


class TestImmutability:
    @pytest.mark.parametrize("name", METHODS)
    def test_a_result_stays_when_the_next_call_is_made(self, arm, name):
        """Pinocchio's functions return views of the workspace that they write into."""
        method = METHODS[name]
        first = method(arm, *state(arm, 1))
        kept = first.copy()
        for other in METHODS.values():
            other(arm, *state(arm, 2))
        np.testing.assert_array_equal(first, kept)

    def test_poses_stay_when_the_next_call_is_made(self, arm):
        q1, q2, _ = state(arm, 1)
        T, frames = arm.forward_kinematics(q1), arm.frames(q1)
        kept = T.homogeneous.copy(), [F.homogeneous.copy() for F in frames]
        arm.forward_kinematics(q2)
        arm.frames(q2)
        np.testing.assert_array_equal(T.homogeneous, kept[0])
        np.testing.assert_array_equal([F.homogeneous for F in frames], kept[1])

    @pytest.mark.parametrize("name", METHODS)
    def test_changing_a_result_does_not_change_the_next(self, arm, name):
        method = METHODS[name]
        first = method(arm, *state(arm, 1))
        kept = first.copy()
        first[...] = np.nan
        np.testing.assert_array_equal(method(arm, *state(arm, 1)), kept)

    @pytest.mark.parametrize("name", METHODS)
    def test_arguments_are_left_alone(self, arm, name):
        arguments = state(arm, 5)
        kept = [x.copy() for x in arguments]
        METHODS[name](arm, *arguments)
        for x, before in zip(arguments, kept, strict=True):
            np.testing.assert_array_equal(x, before)

    def assert_the_same(self, arm, before):
        after = [method(arm, *state(arm, 3)) for method in METHODS.values()]
        for one, two in zip(before, after, strict=True):
            np.testing.assert_array_equal(one, two)

    def vandalise(self, model):
        model.armature = model.armature + 5
        model.gravity = pin.Motion.Zero()
        model.lowerPositionLimit = model.lowerPositionLimit - 1
        for inertia in model.inertias:
            inertia.mass = 100.0
        for placement in model.jointPlacements:
            placement.translation = placement.translation + 1
        for frame in model.frames:
            frame.placement = pin.SE3.Random()

    def test_changing_the_model_that_it_shows(self, arm):
        before = [method(arm, *state(arm, 3)) for method in METHODS.values()]
        limits, armature = arm.lower, arm.armature
        self.vandalise(arm.model)
        model = arm.model
        self.vandalise(model)
        self.assert_the_same(arm, before)
        np.testing.assert_array_equal(arm.lower, limits)
        np.testing.assert_array_equal(arm.armature, armature)

    def test_changing_the_model_that_it_was_made_of(self, arm):
        model = arm.model
        mine = k1607.Arm(model, arm.tool_frame)
        before = [method(mine, *state(arm, 3)) for method in METHODS.values()]
        for one, two in zip(before, (method(arm, *state(arm, 3)) for method in METHODS.values()), strict=True):
            np.testing.assert_array_equal(one, two)
        self.vandalise(model)
        self.assert_the_same(mine, before)

    def test_changing_its_limits(self, arm):
        for name in ("lower", "upper", "velocity_limit", "effort_limit", "armature"):
            kept = getattr(arm, name)
            getattr(arm, name)[:] = 99
            np.testing.assert_array_equal(getattr(arm, name), kept)

    @pytest.mark.parametrize("name", ["lower", "upper", "n", "model", "tool_frame", "armature", "joint_names", "name"])
    def test_attributes_cannot_be_set(self, arm, name):
        with pytest.raises(AttributeError):
            setattr(arm, name, getattr(arm, name))

    @pytest.mark.parametrize("which", ["visual_model", "collision_model"])
    def test_changing_its_geometry(self, reference, which):
        def names(arm):
            return [shape.name for shape in getattr(arm, which).geometryObjects]

        before = names(reference)
        assert before
        shown = getattr(reference, which)
        shown.removeGeometryObject(before[0])
        assert names(reference) == before
        given = getattr(reference, which)
        mine = k1607.Arm(reference.model, "tool", given, given)
        given.removeGeometryObject(before[0])
        assert names(mine) == before

    def test_without_geometry_there_is_none(self, reference):
        arm = k1607.Arm(reference.model, "tool")
        assert arm.visual_model is None
        assert arm.collision_model is None


class TestThreads:
    def test_eight_at_once_give_what_one_gives_bit_for_bit(self, arm):
        states = [state(arm, seed) for seed in range(48)]
        expected = [[method(arm, *each) for method in METHODS.values()] for each in states]
        start = threading.Barrier(8)

        def hammer(worker):
            start.wait()
            order = np.random.default_rng(worker).permutation(len(states)).tolist() * 4
            return [(k, [method(arm, *states[k]) for method in METHODS.values()]) for k in order]

        with ThreadPoolExecutor(8) as pool:
            results = [pair for future in [pool.submit(hammer, w) for w in range(8)] for pair in future.result()]
        assert len(results) == 8 * 4 * 48
        for k, values in results:
            for found, value in zip(values, expected[k], strict=True):
                np.testing.assert_array_equal(found, value)

    def test_each_thread_has_its_own_workspace(self, arm):
        """Held against scheduling that never switches inside a call: two threads must not share Pinocchio's Data."""
        mine, theirs = arm._workspace.data, []
        thread = threading.Thread(target=lambda: theirs.append(arm._workspace.data))
        thread.start()
        thread.join()
        assert theirs[0] is not mine
        assert arm._workspace.data is mine


class TestWhatItIs:
    def test_three_arms(self, arm):
        assert arm.n == {"k1607": 7, "panda": 7, "ur5": 6}[arm.name]
        assert len(arm.joint_names) == len(set(arm.joint_names)) == arm.n == arm.model.nv
        assert f"{arm.n} joints" in repr(arm)
        assert arm.tool_frame in repr(arm)
        assert (arm.lower < arm.upper).all()
        for limit in (arm.lower, arm.upper, arm.velocity_limit, arm.effort_limit, arm.armature):
            assert limit.shape == (arm.n,)

    def test_frames_of_the_k1607_are_those_of_the_report(self, reference):
        q = np.random.default_rng(9).uniform(-np.pi, np.pi, 7)
        expected = product.frame_transforms(table_1(), *product.cosines_and_sines(q))
        np.testing.assert_allclose([T.homogeneous for T in reference.frames(q)], expected, rtol=0, atol=1e-14)

    @pytest.mark.parametrize(("size", "shape"), [((), ()), (3, (3,)), ((2, 3), (2, 3)), (0, (0,)), (np.int64(4), (4,))])
    def test_random_configurations_lie_within_limits(self, arm, size, shape):
        q = arm.random_configuration(np.random.default_rng(1), size)
        assert q.shape == (*shape, arm.n)
        assert ((q >= arm.lower) & (q <= arm.upper)).all()
        np.testing.assert_array_equal(q, arm.random_configuration(np.random.default_rng(1), size))

    def test_random_configurations_fill_the_limits(self, arm):
        """20000 uniform draws leave a gap of a thousandth of the range with probability e^-20."""
        q = arm.random_configuration(np.random.default_rng(1), 20_000)
        share = (q - arm.lower) / (arm.upper - arm.lower)
        assert (share.min(axis=0) < 1e-3).all()
        assert (share.max(axis=0) > 1 - 1e-3).all()
        np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=5 * np.sqrt(1 / 12 / 20_000))

    def test_random_configurations_without_limits(self, reference):
        model = reference.model
        model.lowerPositionLimit, model.upperPositionLimit = np.full(7, -np.inf), np.full(7, np.inf)
        q = k1607.Arm(model, "tool").random_configuration(np.random.default_rng(1), 500)
        assert (np.abs(q) <= np.pi).all()
        assert np.abs(q).max() > 3

    def test_armature_sits_on_the_diagonal_of_the_mass_matrix_and_nowhere_else(self, reference):
        q, v, a = state(reference, 4)
        bare = k1607.load_k1607(armature=np.zeros(7))
        extra = reference.mass_matrix(q) - bare.mass_matrix(q)
        np.testing.assert_allclose(extra, np.diag(reference.armature), rtol=0, atol=1e-13)
        assert (reference.armature > 0).all()
        np.testing.assert_array_equal(bare.gravity_torque(q), reference.gravity_torque(q))
        np.testing.assert_allclose(bare.bias_torque(q, v), reference.bias_torque(q, v), rtol=0, atol=1e-12)
        torque = reference.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(torque, reference.armature * a, rtol=0, atol=1e-12)
        held = reference.forward_dynamics(q, v, reference.inverse_dynamics(q, v, a))
        np.testing.assert_allclose(held, a, rtol=0, atol=1e-11)

    def test_an_arm_of_one_joint(self, tmp_path):
        """Pinocchio hands back (6,) for its Jacobian: ours is (6, 1)."""
        body = {"mass_kg": 2.0, "cg_m": [0.5, 0.0, 0.0], "inertia_kg_m2": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]}
        units = {"length": "m", "angle": "deg"}
        table = {"dh": {"rows": [[90, 0, 0.1]], "units": units}, "link": [body]}
        path = tmp_path / "pendulum.urdf"
        path.write_text(to_urdf(description.from_mapping(table)))
        arm = k1607.load_urdf(path)
        q = np.array([0.3])
        assert arm.jacobian(q).shape == (6, 1)
        assert arm.jacobian(q[None]).shape == (1, 6, 1)
        assert arm.forward_kinematics(q[None]).shape == (1, 4, 4)
        assert arm.mass_matrix(q) == pytest.approx(np.array([[0.1 + 2.0 * 0.25]]))
        assert arm.gravity_torque(q) == pytest.approx(np.array([2.0 * 9.81 * 0.5 * np.cos(0.3)]))


class TestBadArguments:
    CALLS = (
        ("forward_kinematics", ("q",)), ("frames", ("q",)), ("jacobian", ("q",)), ("mass_matrix", ("q",)),
        ("gravity_torque", ("q",)), ("bias_torque", ("q", "v")), ("coriolis_matrix", ("q", "v")),
        ("forward_dynamics", ("q", "v", "tau")), ("inverse_dynamics", ("q", "v", "a")),
    )  # fmt: skip
    WRONG = (
        np.full(6, 0.1), np.full(8, 0.1), 0.1, [], None, "seven", ["a"] * 7, [[0.1] * 7, [0.1]], {"q": 1}, [0.1] * 5,
    )  # fmt: skip

    def each(self, n):
        """Every method, every argument of it: (method, its name, where it stands, good arguments)."""
        for name, arguments in self.CALLS:
            for k, argument in enumerate(arguments):
                yield name, argument, k, [np.zeros(n) for _ in arguments]

    @pytest.mark.parametrize("bad", WRONG, ids=lambda x: repr(x)[:12])
    def test_wrong_shapes_and_kinds_are_named(self, reference, bad):
        for name, argument, k, arguments in self.each(7):
            arguments[k] = bad
            with pytest.raises(ValueError, match=f"^{argument}: expected"):
                getattr(reference, name)(*arguments)

    def test_complex_numbers_are_named(self, reference):
        """Not half read."""
        for name, argument, k, arguments in self.each(7):
            arguments[k] = np.full(7, 0.1 + 1j)
            with pytest.raises(ValueError, match=f"^{argument}: expected"):
                getattr(reference, name)(*arguments)

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    @pytest.mark.parametrize("others", [0.0, 1e200], ids=["among zeros", "among numbers whose squares overflow"])
    def test_what_is_not_finite_is_named(self, arm, value, others):
        for name, argument, k, arguments in self.each(arm.n):
            for joint in range(arm.n):
                arguments[k] = np.full(arm.n, others)
                arguments[k][joint] = value
                with pytest.raises(ValueError, match=f"^{argument}: expected"):
                    getattr(arm, name)(*arguments)

    @pytest.mark.parametrize("name", ["forward_kinematics", "jacobian"])
    @pytest.mark.parametrize(
        "bad", [np.zeros((2, 6)), np.zeros((7, 3)), np.full((2, 7), np.nan), [[0.0] * 7, [0.0] * 6]]
    )
    def test_bad_batches_are_named(self, reference, name, bad):
        with pytest.raises(ValueError, match=r"^q: expected"):
            getattr(reference, name)(bad)

    @pytest.mark.parametrize("name", [name for name, _ in CALLS if name not in ("forward_kinematics", "jacobian")])
    def test_dynamics_take_no_batches(self, reference, name):
        names = dict(self.CALLS)[name]
        with pytest.raises(ValueError, match=r"^q: expected"):
            getattr(reference, name)(np.zeros((2, 7)), *[np.zeros(7)] * (len(names) - 1))

    @settings(max_examples=30)
    @given(seed=SEED)
    def test_lists_tuples_and_other_numbers_will_do(self, arm, seed):
        """Whole numbers and single precision are converted, not reinterpreted."""
        arguments = [np.round(4 * x) / 4 for x in state(arm, seed)]  # exact in single precision
        for method in METHODS.values():
            expected = method(arm, *arguments)
            for kind in (list, tuple, lambda x: x.astype(np.float32), lambda x: x.astype(object)):
                np.testing.assert_array_equal(method(arm, *map(kind, arguments)), expected)
            whole = [np.round(x) for x in arguments]
            np.testing.assert_array_equal(method(arm, *(x.astype(int) for x in whole)), method(arm, *whole))

    def test_huge_finite_numbers_are_numbers(self, arm):
        """Their sum of squares overflows; that is no reason to refuse or to warn."""
        q = np.full(arm.n, 1e200)
        T = arm.forward_kinematics(q)
        np.testing.assert_allclose(T.rotation @ T.rotation.T, np.eye(3), rtol=0, atol=1e-12)
        assert np.isfinite(arm.mass_matrix(q)).all()
        np.testing.assert_array_equal(arm.forward_kinematics(q[None])[0], T.homogeneous)


def test_limits_that_contradict_are_refused():
    model = k1607.load_k1607().model
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    lower[2], upper[2] = upper[2], lower[2]
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    with pytest.raises(ValueError, match=r"joint3.*expected a lower limit below the upper one"):
        k1607.Arm(model, "tool")
