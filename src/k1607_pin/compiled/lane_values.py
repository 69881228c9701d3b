"""Numbers that differ from rollout to rollout, held against what their owners say of them, and where each rollout starts."""

from collections.abc import Mapping, Sequence

import numpy as np

from k1607_pin.compiled.closed_loop import ClosedLoop, Setup, is_of_arm
from k1607_pin.compiled.leaves import replaced

FEW = 64  # rollouts that all are checked


def require_values(setup: Setup, loop: ClosedLoop, values: Mapping[str, np.ndarray]) -> None:
    """Numbers as controller, plant and payloads check theirs: of all rollouts if they are few, else of the extreme ones."""
    seeds = [name for name, _ in loop.law_tables.noise]
    for name, x in values.items():
        kind = name.rpartition(".")[2] if is_of_arm(name) else ""
        if name in seeds and (wrong := (x != np.floor(x)) | (x < 0) | (x > 2**53)).any():
            raise ValueError(f"{name}: expected whole numbers from 0 to 2^53, got {x[wrong][0]!r}")
        lowest = {"armature": x, "inertial": x[..., 0]}.get(kind)
        if lowest is not None and (lowest < 0).any():
            raise ValueError(f"{name}: expected no negative inertia or mass, got {lowest.min():g}")
    lanes = {0}
    for x in values.values():
        if len(x) <= FEW:
            lanes |= set(range(len(x)))
        flat = x.reshape(len(x), -1)
        lanes |= {int(flat.min(axis=1).argmin()), int(flat.max(axis=1).argmax())}
    roots = {
        "plant": setup.plant,
        "controller": setup.controller,
        "external": setup.external,
        "payloads": setup.schedule.changes,
    }
    for lane in lanes:
        for root, x in roots.items():
            mine = {name: value for name, value in values.items() if name.startswith(f"{root}.")}
            own = {name.partition(".")[2]: value[min(lane, len(value) - 1)] for name, value in mine.items()}
            own = {name: v if v.ndim else float(v) for name, v in own.items() if not is_of_arm(f"{root}.{name}")}
            replaced(x, own)


def given_states(
    setup: Setup, loop: ClosedLoop, varied: Sequence[str], values: Mapping[str, np.ndarray], count: int, duration: float
) -> np.ndarray:
    """(count, size): what the controller starts from, asked for one by one where it may differ."""
    mine = [name for name in varied if name.startswith("controller.") and not is_of_arm(name)]
    if not mine and len(values["q0"]) == len(values["v0"]) == 1:
        state = setup.controller.start(values["q0"][0].copy(), values["v0"][0].copy(), duration)
        return np.broadcast_to(np.array(loop.state.flat(state), dtype=float), (count, loop.state.size))
    out = np.empty((count, loop.state.size))
    for i in range(count):
        own = {name.partition(".")[2]: values[name][i % len(values[name])] for name in mine}
        controller = replaced(setup.controller, {k: x if x.ndim else float(x) for k, x in own.items()})
        q, v = (values[name][i % len(values[name])] for name in ("q0", "v0"))
        out[i] = loop.state.flat(controller.start(q.copy(), v.copy(), duration))
    return out
