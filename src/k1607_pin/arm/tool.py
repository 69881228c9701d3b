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
    if len(names) != 1:
        joints = ", ".join(repr(model.names[j]) for j in sorted(last))
        shown = ", ".join(names[:MOST_SHOWN]) + (", ..." if len(names) > MOST_SHOWN else "")
        one = names[0] if names else model.frames[model.nframes - 1].name
        raise ValueError(
            f"tool_frame: {model.name!r} has several ends beyond {joints}: {shown}. Say which one is the tool: "
            f"tool_frame={one!r}, on the command line --tool-frame {one}"
        )
    return names[0]


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
