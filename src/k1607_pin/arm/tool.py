"""Which frame is the tool, where nobody says: the one leaf beyond the last joint of the longest moving chain."""

from collections.abc import Collection

import pinocchio as pin

MOST_SHOWN = 20


def tool_of(model: pin.Model, still: Collection[int] = ()) -> str:
    """Name of the tool frame of ``model``, whose joints ``still`` do not move.

    Raises
    ------
    ValueError
        No movable joint, several chains of the same length, or several leaves beyond the last joint: candidates are listed.
    """
    moving = [[j for j in model.supports[i] if j > 0 and j not in still] for i in range(model.njoints)]
    longest = max(len(chain) for chain in moving)
    if longest == 0:
        raise ValueError(f"{model.name!r}: no movable joint")
    last = {chain[-1] for chain in moving if len(chain) == longest}
    leaves = [leaf for leaf in _leaves(model) if moving[model.frames[leaf].parentJoint][-1:] in [[j] for j in last]]
    names = [model.frames[leaf].name for leaf in leaves]
    if len(names) == 1:
        return names[0]
    joints = ", ".join(repr(model.names[j]) for j in sorted(last)[:MOST_SHOWN])
    before = _before(model, [moving[j] for j in last], longest)
    also = f"; before them: {', '.join(before)}" if before else ""
    one = (before or names)[0]
    raise ValueError(
        f"tool_frame: {model.name!r} has several ends beyond {joints}: {', '.join(names[:MOST_SHOWN])}{also}. "
        f"Say which one is the tool: "
        f"tool_frame={one!r}, on the command line --tool-frame {one}"
    )


def _before(model: pin.Model, chains: list[list[int]], longest: int) -> list[str]:
    """Links of the joint after which the chains part, if that is a hand's and not a torso's: the hand, or what is fixed to it."""
    shared = [j for j, *others in zip(*chains, strict=True) if set(others) <= {j}]
    if len(chains) == 1 or 2 * len(shared) < longest:
        return []
    leaves = [i for i in _leaves(model) if model.frames[i].parentJoint == shared[-1]]
    parting = {chain[len(shared)] for chain in chains}
    carriers = {f.parentFrame for f in model.frames if f.type == pin.JOINT and f.parentJoint in parting}
    return [model.frames[i].name for i in (leaves or sorted(carriers))][:MOST_SHOWN]


def _leaves(model: pin.Model) -> list[int]:
    """Links that nothing is fixed to, and no joint follows."""
    frames = model.frames
    inner = set()
    for i in range(1, model.nframes):
        parent = frames[i].parentFrame
        while parent > 0 and frames[parent].type != pin.BODY:
            parent = frames[parent].parentFrame
        if frames[i].type == pin.BODY:
            inner.add(parent)
    return [i for i in range(1, model.nframes) if frames[i].type == pin.BODY and i not in inner]
