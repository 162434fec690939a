"""The fast path: columns and streams give what solve_ik gives, and refuse what they cannot take."""

import numpy as np
import pytest

import jaxik
from tests.helpers.arms import ALL_PRESETS
from tests.helpers.reachable import postures, target_of


def columns_of(arm, count):
    """Batch-last columns of random reachable targets, and the target they come from."""
    target = target_of(arm, postures(arm, count, seed=1))
    directions = target.rotation if arm.n_joints == 7 else target.direction[..., None]
    swivel = np.random.default_rng(2).uniform(-3, 3, count)
    return (np.moveaxis(target.position, 0, -1), np.moveaxis(directions, 0, -1), swivel), target


@pytest.mark.parametrize("name", ["iiwa14", "meccanoid_right"])
def test_columns_give_what_solve_ik_gives(name):
    arm = ALL_PRESETS[name]().arm
    columns, target = columns_of(arm, 64)
    solution = jaxik.solve_ik(arm, target, columns[2])
    branches = jaxik.solve_ik_columns(arm, *columns)
    np.testing.assert_allclose(np.moveaxis(branches.q, -1, 0), solution.q, atol=1e-12)
    np.testing.assert_array_equal(np.moveaxis(branches.status, -1, 0), solution.status)
    for branch in range(8):
        np.testing.assert_array_equal(np.stack(branches.joints(branch)), branches.q[branch])
        np.testing.assert_array_equal(branches.branch_status(branch), branches.status[branch])
    np.testing.assert_array_equal(np.moveaxis(branches.ok, -1, 0), solution.ok)
    if np.all(np.any(branches.ok, axis=0)):
        assert branches.raise_if_invalid() is branches
    else:
        with pytest.raises(jaxik.UnreachableError, match="of 64 targets have no feasible branch; row"):
            branches.raise_if_invalid()


def test_a_stream_covers_every_row_once_in_order():
    arm = ALL_PRESETS["iiwa14"]().arm
    columns, target = columns_of(arm, 100)
    solution = jaxik.solve_ik(arm, target, columns[2])
    seen = []
    for rows, branches in jaxik.stream_ik(arm, *columns, chunk=32):
        seen.extend(range(rows.start, rows.stop))
        np.testing.assert_allclose(np.moveaxis(branches.q, -1, 0), solution.q[rows], atol=1e-12)
    assert seen == list(range(100))


def test_wrong_layouts_say_what_was_expected(without_type_checks):
    arm = ALL_PRESETS["iiwa14"]().arm
    with pytest.raises(ValueError, match=r"expected position \(3, n\).* got \(5, 3\), \(5, 3, 3\) and \(5,\)"):
        jaxik.solve_ik_columns(arm, np.zeros((5, 3)), np.zeros((5, 3, 3)), np.zeros(5))
    with pytest.raises(ValueError, match="expected a positive chunk and number of threads, got 0"):
        next(jaxik.stream_ik(arm, np.zeros((3, 4)), np.zeros((3, 3, 4)), np.zeros(4), chunk=0))
