"""The families of singular configurations: every member is singular, every singular configuration is a member."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from k1607_pin.kinematics import closed_form
from k1607_pin.kinematics.singularities import FAMILIES, residuals

COMPLETE = ("straight", "elbow", "wrist", "general")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda f: f.name)
def test_members_are_singular_and_of_the_stated_rank(family):
    rng = np.random.default_rng(5)
    Q = np.array([family.member(rng) for _ in range(500)])
    sigma = np.linalg.svd(closed_form.jacobian(Q), compute_uv=False)
    assert sigma[:, 5].max() < 1e-13
    assert np.median(sigma[:, family.rank - 1]) > 0.05  # and no lower rank but on thin subsets
    name = family.name.split()[0] if family.name in COMPLETE else "general"
    assert max(np.abs(residuals(q)[name]).max() for q in Q) < 1e-14


def test_random_configurations_belong_to_no_family():
    for q in np.random.default_rng(6).uniform(-np.pi, np.pi, (500, 7)):
        assert all(np.abs(r).max() > 1e-6 for r in residuals(q).values())


def test_every_singular_configuration_belongs_to_a_family():
    """Search the whole torus for J^T w = 0 with |w| = 1; whatever is found must meet some family's conditions."""
    rng = np.random.default_rng(7)

    def equations(x):
        J = closed_form.jacobian(np.concatenate([[0], x[:5], [0]]))
        return np.append(J.T @ x[5:], x[5:] @ x[5:] - 1)

    found = {name: 0 for name in COMPLETE}
    for _ in range(60):
        start = np.concatenate([rng.uniform(-np.pi, np.pi, 5), rng.normal(size=6)])
        solution = least_squares(equations, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        q = np.concatenate([[0], solution.x[:5], [0]])
        if np.linalg.svd(closed_form.jacobian(q), compute_uv=False)[5] > 1e-10:
            continue  # a local minimum, not a singularity
        # determinants of lengths: 1e-7 is what an error of 1e-7 rad in a double root leaves
        members = [name for name, r in residuals(q).items() if np.abs(r).max() < 1e-7]
        assert members, q
        for name in members:
            found[name] += 1
    assert sum(found.values()) > 40
    assert found["general"] > 0
    assert found["wrist"] > 0
