import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin import data
from k1607_pin.description import description
from k1607_pin.description.dh import table_1
from k1607_pin.description.inertia import LinkInertia, assemble, k1607_links, rod, shift_rods
from k1607_pin.description.urdf import to_urdf

SEED = st.integers(0, 2**32 - 1)


def random_body(rng):
    """Twenty point masses: physical by construction."""
    points, weights = rng.normal(size=(20, 3)), rng.uniform(0.1, 1, 20)
    mass, cg = weights.sum(), weights @ points / weights.sum()
    r = points - cg
    inertia = np.einsum("k,kij->ij", weights, (r**2).sum(1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :])
    return LinkInertia(mass, cg, inertia)


def as_pin(body):
    return pin.Inertia(body.mass, body.cg, body.inertia)


def assert_same(body, expected):
    np.testing.assert_allclose(body.mass, expected.mass, rtol=1e-14)
    np.testing.assert_allclose(body.cg, expected.lever, rtol=0, atol=1e-13)
    np.testing.assert_allclose(body.inertia, expected.inertia, rtol=0, atol=1e-12)


@given(seed=SEED)
def test_sum_and_motion_agree_with_pinocchio(seed):
    rng = np.random.default_rng(seed)
    one, two = random_body(rng), random_body(rng)
    assert_same(one + two, as_pin(one) + as_pin(two))
    T = pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), rng.normal(size=3))
    assert_same(one.moved(T.rotation, T.translation), T.act(as_pin(one)))


@given(seed=SEED, scale=st.floats(1.001, 10))
def test_physical_or_not(seed, scale):
    body = random_body(np.random.default_rng(seed))
    assert body.is_physical()
    moments, axes = np.linalg.eigh(body.inertia)
    broken = axes @ np.diag([moments[0], moments[1], scale * (moments[0] + moments[1])]) @ axes.T
    assert not LinkInertia(body.mass, body.cg, broken).is_physical()
    assert not LinkInertia(-body.mass, body.cg, body.inertia).is_physical()
    assert not LinkInertia(0.0, body.cg, body.inertia).is_physical()
    assert not LinkInertia(body.mass, body.cg, -body.inertia).is_physical()


@given(seed=SEED, moment=st.floats(1e-3, 10))
def test_a_rod_has_no_inertia_about_itself(seed, moment):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    tensor = rod(axis, moment).inertia
    np.testing.assert_allclose(np.linalg.eigvalsh(tensor), [0, moment, moment], rtol=0, atol=1e-14 * moment)
    np.testing.assert_allclose(tensor @ axis, 0, atol=1e-15 * moment)


def test_every_link_is_physical_and_only_thanks_to_the_rods():
    assert all(link.is_physical() for link in k1607_links())
    as_published = [link.is_physical() for link in assemble()]
    broken = {i + 1 for i, physical in enumerate(as_published) if not physical}
    assert broken == set(data.load("k1607_modules")["rod_shift"]["distal_link"])


def test_rods_move_no_mass():
    for before, after in zip(assemble(), k1607_links(), strict=True):
        assert before.mass == after.mass
        np.testing.assert_array_equal(before.cg, after.cg)


def test_assembly_does_not_depend_on_calls_before():
    first = shift_rods(assemble(), table_1())
    second = k1607_links()
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.inertia, two.inertia)


@pytest.fixture(scope="module")
def shifted_and_not():
    arm = description.k1607()
    published = dataclasses.replace(arm, links=assemble())
    return [pin.buildModelFromXML(to_urdf(each)) for each in (arm, published)]


@given(seed=SEED)
def test_the_rods_change_no_motion(shifted_and_not, seed):
    """M, C v, g and the torques of any motion: equal to rounding, relative to their size.

    C too: Pinocchio builds it from quantities that a rod about its own axis does not enter.
    """
    rng = np.random.default_rng(seed)
    q, v, a = rng.uniform(-np.pi, np.pi, 7), rng.normal(size=7), rng.normal(size=7)

    def dynamics(model):
        workspace = model.createData()
        yield pin.crba(model, workspace, q).copy()
        yield pin.computeGeneralizedGravity(model, workspace, q).copy()
        yield pin.rnea(model, workspace, q, v, 0 * a) - pin.rnea(model, workspace, q, 0 * v, 0 * a)
        yield pin.rnea(model, workspace, q, v, a).copy()

    for shifted, published in zip(*map(dynamics, shifted_and_not), strict=True):
        np.testing.assert_allclose(shifted, published, rtol=0, atol=1e-12 * np.abs(published).max())


def test_the_models_with_and_without_rods_do_differ(shifted_and_not):
    """Or the test above would compare a thing with itself."""
    one, two = ([inertia.inertia for inertia in model.inertias][1:] for model in shifted_and_not)
    assert all(np.abs(a - b).max() > 1e-4 for a, b in zip(one, two, strict=True))
