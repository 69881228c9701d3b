"""The law of the hybrid position/force scheme, figure 14: adaptive PD on positions where S is 0, on forces where it is 1.

A reconstruction: the report cites its force law and does not print it. docs/hybrid.md derives this one.
"""

from typing import Any, NamedTuple

import numpy as np

from k1607_pin.control.adaptation import Gains, gain_rates, proportional_derivative
from k1607_pin.control.pose import pose_error
from k1607_pin.control.practice import OFF, Practice, limited, next_gains


class Loop(NamedTuple):
    """Weights and rates of one loop's adaptation."""

    P_2: Any
    """(6, 6) of a `ReferenceModel`"""
    P_3: Any
    """(6, 6)"""
    beta_1: Any
    beta_2: Any


class HybridState(NamedTuple):
    """What the scheme carries from one control period to the next."""

    position: Gains
    """(6, 6) each, compliance axes: N/m, N s/m and their angular likes"""
    force: Gains
    """(6, 6) each, compliance axes: 1 (N per N), s"""
    velocity: Any
    """(n,) rad/s, filtered"""
    selection: Any
    """(6,) diagonal of S at the last sample"""
    wanted_force: Any
    """(6,) N, N m at the last sample, compliance axes"""
    offset: Any
    """(6,) of the reference, compliance axes: m, rad where S is 0, N, N m where it is 1; brings a newly chosen direction over"""
    offset_rate: Any
    """(6,) per s"""
    transfer: Any
    """(6,) N, N m, compliance axes: what the last switch would have made the command jump by, fading"""
    integral: Any = 0.0
    """(6,) N, N m, compliance axes: what the force errors have added up to"""


class HybridStep(NamedTuple):
    """One control period's outcome."""

    torque: Any
    """(n,) N m, held until the next period"""
    state: HybridState
    error: Any
    """(6,) m, rad: wanted less actual pose, compliance axes, all six; what S selects is not acted on"""
    force: Any
    """(6,) N, N m of the tool on the world, measured, compliance axes"""
    force_error: Any
    """(6,) N, N m: wanted less measured, compliance axes; 0 where S is 0"""
    command: Any
    """(6,) N, N m: the two loops' force on the tool, compliance axes"""
    share: Any
    """Of the torque asked for that the limit lets through, at most 1"""


def hybrid_adaptive(
    position: Any,
    rotation: Any,
    J: Any,
    v: Any,
    wrench: Any,
    wanted_position: Any,
    wanted_rotation: Any,
    wanted_velocity: Any,
    selection: Any,
    wanted_force: Any,
    state: HybridState,
    compliance: Any,
    stiffness: Any,
    position_loop: Loop,
    force_loop: Loop,
    transition: Any,
    period: Any,
    start: tuple[Gains, Gains] | None = None,
    other_torque: Any = 0.0,
    practice: Practice = OFF,
    force_practice: Practice = OFF,
    force_integral: Any = 0.0,
    touch: Any = 0.0,
) -> HybridStep:
    """One step of the scheme: torque from the present gains, then the gains adapted; docs/hybrid.md, (H1)-(H10).

    Parameters
    ----------
    position (3,) m, rotation (3, 3) : the tool's pose; J (6, n) : its Jacobian; v (n,) rad/s.
    wrench : (6,) N, N m of the world on the tool, base axes.
    wanted_position (3,) m, wanted_rotation (3, 3), wanted_velocity (6,) m/s and rad/s : base axes.
    selection : (6,) 0 or 1; wanted_force : (6,) N, N m of the tool on the world; both in compliance axes.
    compliance : (3, 3) the compliance axes, columns, in the base.
    stiffness : (6,) N/m, N m/rad assumed of the contact, compliance axes: at least the stiffest to be met.
    transition : s, in which what a switch leaves behind fades; period : s.
    start : K(0) of the position loop and of the force loop, for a practice that refers to them; None for the present gains.
    other_torque : (n,) N m, added to the law's before the limit.
    practice : options beyond the report; of ``force_practice`` only sigma, gain_bound and dead_zone count, for the force loop.
    force_integral : 1/s, gain of the force error's integral, (H10).
    touch : N, N m, one number or (6,), compliance axes: what a selected force must exceed to be more than a sensor's noise.
    """
    error = _turned(compliance, pose_error(position, rotation, wanted_position, wanted_rotation))
    twist = _turned(compliance, J @ v)
    error_rate = _turned(compliance, wanted_velocity) - twist
    measured = -_turned(compliance, wrench)
    force_error, force_rate = wanted_force - measured, -stiffness * twist
    both = (1 - selection) * error + selection * force_error
    both_rate = (1 - selection) * error_rate  # a force's starts at rest: its rate would be the stiffness' guess

    old, is_new = state.selection, np.abs(selection - state.selection)
    offset = state.offset + is_new * (-both - state.offset)
    offset_rate = state.offset_rate + is_new * (-both_rate - state.offset_rate)

    def command(selection: Any, wanted_force: Any, offset: Any, offset_rate: Any) -> tuple[Any, ...]:
        x, x_rate = (1 - selection) * (error + offset), (1 - selection) * (error_rate + offset_rate)
        f, f_rate = selection * (wanted_force - measured + offset), selection * (force_rate + offset_rate)
        by_position = (1 - selection) * proportional_derivative(state.position, x, x_rate)
        feedback = proportional_derivative(state.force, f, f_rate) + state.integral
        by_force = selection * (wanted_force + offset + feedback)
        return by_position + by_force, x, x_rate, f, f_rate

    after, x, x_rate, f, f_rate = command(selection, wanted_force, offset, offset_rate)
    before = command(old, state.wanted_force, state.offset, state.offset_rate)[0]  # as if nothing had been switched
    switches = np.where(np.sum(is_new) > 0, 1.0, 0.0)
    transfer = state.transfer + switches * (before - after)
    force = after + transfer
    torque, share = limited(J.T @ _back(compliance, force) + other_torque, practice)

    starts = start or (state.position, state.force)
    rates = gain_rates(*position_loop, x, x_rate)
    in_touch = np.where(np.max(np.abs(selection * measured) - touch) > 0, 1.0, 0.0)
    force_rates = Gains(*(in_touch * rate for rate in gain_rates(*force_loop, f, f_rate)))
    # Divided by the stiffness the force loop's gains are of one kind with the others: symmetric, and adapted alike, (H5).
    at_start, now = (per_stiffness(gains, stiffness) for gains in (starts[1], state.force))
    learnt = next_gains(at_start, now, force_rates, f, share, period, force_practice)
    column = np.reshape(stiffness, (6, 1))
    force_gains = Gains(*(k + column * (new - old) for k, new, old in zip(state.force, learnt, now, strict=True)))
    learning = in_touch * np.where(share < 1, 0.0, 1.0)
    next_offset, next_offset_rate = _faded(offset, offset_rate, transition, period)
    following = HybridState(
        next_gains(starts[0], state.position, rates, x, share, period, practice),
        force_gains,
        v,
        selection,
        wanted_force,
        next_offset,
        next_offset_rate,
        transfer * np.exp(-period / transition),
        state.integral + period * force_integral * learning * f,
    )
    return HybridStep(torque, following, error, measured, selection * force_error, force, share)


def per_stiffness(gains: Gains, stiffness: Any) -> Gains:
    """K^-1 (I + K_p) and K^-1 K_d of force gains, (6, 6) each: under (H8) multiples of K^-1 Lambda K^-1, as in (H7)."""
    column = np.reshape(stiffness, (6, 1))
    return Gains((np.eye(6) + gains.K_p) / column, gains.K_d / column)


def _turned(compliance: Any, x: Any) -> Any:
    """(6,) from base axes to compliance axes."""
    return np.concatenate([compliance.T @ x[:3], compliance.T @ x[3:]])


def _back(compliance: Any, x: Any) -> Any:
    return np.concatenate([compliance @ x[:3], compliance @ x[3:]])


def _faded(offset: Any, rate: Any, transition: Any, period: Any) -> tuple[Any, Any]:
    """The offset and its rate one period on, critically damped towards zero: exact, and the rate has no jump."""
    slope, left = rate + offset / transition, np.exp(-period / transition)
    return (offset + slope * period) * left, (rate - slope * (period / transition)) * left
