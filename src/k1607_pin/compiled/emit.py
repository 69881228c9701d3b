"""Programs as C: on plain doubles, or on vectors of them, one closed loop a lane."""

from collections.abc import Collection, Sequence

from k1607_pin.compiled.program import Program, require_inputs

BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
COMPARISONS = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
LIBM = {
    "exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "erf", "log1p", "expm1", "floor", "ceil", "fabs", "fmin", "fmax", "pow", "atan2", "fmod", "hypot", "copysign",
}  # fmt: skip


def function(name: str, program: Program, sizes: Sequence[int], shared: Collection[int] = (), kind: str = "V") -> str:
    """A static C function ``name(i0, i1, ..., o0, o1, ...)`` of pointers, none of which may overlap.

    Parameters
    ----------
    sizes : how many numbers its caller passes of each input, used or not; 0 for a null pointer.
    shared : inputs that are doubles, the same for all lanes.
    kind : C type of a value, for which the functions v_sin etc. are defined: "V", vectors, or "double".

    Raises
    ------
    ValueError
        The program reads more than that.
    """
    require_inputs(name, program, sizes)
    inputs = len(sizes)
    arguments = [f"const {'double' if k in shared else kind} *restrict i{k}" for k in range(inputs)]
    arguments += [f"{kind} *restrict o{k}" for k in range(len(program.outputs))]
    lines = [f"static void {name}({', '.join(arguments)})", "{"]
    stores: dict[int, list[str]] = {}
    for k, output in enumerate(program.outputs):
        for i, node in enumerate(output):
            stores.setdefault(node, []).append(f"  o{k}[{i}] = w{node};")
    for node, made in enumerate(body(program, kind, shared)):
        lines += [made, *stores.get(node, ())]  # at once, so that it need not be kept
    unused = {f"i{k}" for k in range(inputs)} - {f"i{node.place[0]}" for node in program.nodes if node.op == "input"}
    lines += [f"  (void){name};" for name in sorted(unused)]
    return "\n".join([*lines, "}", ""])


def body(program: Program, kind: str, shared: Collection[int]) -> list[str]:
    """One line a node, which declares w0, w1, ..."""
    lines = []
    angles: dict[int, set[str]] = {}
    for node in program.nodes:
        if node.op in ("sin", "cos"):
            angles.setdefault(node.args[0], set()).add(node.op)
    made: set[int] = set()
    for i, node in enumerate(program.nodes):
        a = [f"w{k}" for k in node.args]
        if node.op in ("sin", "cos") and len(angles[node.args[0]]) == 2:  # both, for one reduction of the angle
            k = node.args[0]
            both = "" if k in made else f"{kind} s{k}, c{k}; v_sincos(w{k}, &s{k}, &c{k}); "
            made.add(k)
            lines.append(f"  {both}const {kind} w{i} = {node.op[0]}{k};")
            continue
        if node.op == "const":
            text = f"v_all({literal(node.value)})"
        elif node.op == "input":
            text = f"i{node.place[0]}[{node.place[1]}]"
            text = f"v_all({text})" if node.place[0] in shared else text
        elif node.op in BINARY:
            text = f"{a[0]} {BINARY[node.op]} {a[1]}"
        elif node.op in COMPARISONS:
            text = f"v_if({a[0]} {COMPARISONS[node.op]} {a[1]})"
        elif node.op == "sq":
            text = f"{a[0]} * {a[0]}"
        elif node.op == "twice":
            text = f"{a[0]} + {a[0]}"
        elif node.op == "neg":
            text = f"-{a[0]}"
        elif node.op == "inv":
            text = f"v_all(1.0) / {a[0]}"
        elif node.op == "assign":
            text = a[0]
        elif node.op == "not":
            text = f"v_if({a[0]} == v_all(0.0))"
        elif node.op == "and":
            text = f"v_if(({a[0]} != v_all(0.0)) & ({a[1]} != v_all(0.0)))"
        elif node.op == "or":
            text = f"v_if(({a[0]} != v_all(0.0)) | ({a[1]} != v_all(0.0)))"
        elif node.op == "if_else_zero":
            text = f"v_where({a[0]} != v_all(0.0), {a[1]})"
        elif node.op == "sign":
            text = f"v_sign({a[0]})"
        elif node.op == "constpow":
            text = f"v_pow({a[0]}, {a[1]})"
        elif node.op in LIBM:
            text = f"v_{node.op}({', '.join(a)})"
        else:
            raise NotImplementedError(f"operation {node.op!r} has no C")
        lines.append(f"  const {kind} w{i} = {text};")
    return lines


def literal(x: float) -> str:
    """C of a double."""
    if x != x:
        return "NAN"
    if x in (float("inf"), float("-inf")):
        return "INFINITY" if x > 0 else "-INFINITY"
    return repr(float(x))
