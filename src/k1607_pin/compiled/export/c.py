"""The exported functions as C99: a header to be read, and sources that need libm alone."""

import textwrap
from collections.abc import Iterator, Sequence

import numpy as np

from k1607_pin.compiled.emit import literal
from k1607_pin.compiled.export.function import Argument, Field, Function, Struct, fields
from k1607_pin.compiled.export.law import Law
from k1607_pin.compiled.export.plain_c import statements
from k1607_pin.compiled.program import Program, require_inputs

HELPERS = """\
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "without -ffast-math and -ffinite-math-only: they take out the checks for numbers that are not finite"
#endif

static int all_finite(const double *x, int n)
{
  int finite = 1;
  for (int i = 0; i < n; i++) finite &= isfinite(x[i]) != 0;
  return finite;
}

static void set_zero(double *x, int n)
{
  for (int i = 0; i < n; i++) x[i] = 0.0;
}
"""
RULES = """\
SI units; where a joint is prismatic, the unit in brackets holds. Matrices lie row by row. Base axes, linear components before angular ones. Numbers such as (39) are equations of the report.

Every function returns {P}_OK, or {P}_NOT_FINITE if an argument or a result is not a finite number. Then all that it gives is zero and a state stays as it was: NaN never leaves as a torque. A torque of zero holds no arm: see to the brakes.

Nothing is allocated, printed or kept from call to call, so that any number of threads may call. Arguments must not overlap."""  # noqa: E501
WIDTH = 100


def header(prefix: str, about: Sequence[str], functions: Sequence[Function], laws: Sequence[Law]) -> str:
    """The one header: all there is to know for calling."""
    P = prefix.upper()
    parts = [
        _comment([*about, "", *RULES.format(P=P).splitlines()]),
        f'#ifndef {P}_H\n#define {P}_H\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n',
        f"enum {{ {P}_OK = 0, {P}_NOT_FINITE = 1 }};\n",
        *(_declaration(prefix, "", f) for f in functions),
    ]
    for law in laws:
        parts.append(_comment([f"{law.name}: {law.says}", *law.options]))
        parts += [_struct(prefix, law.name, struct) for struct in structs(law)]
        if law.defaults:
            parts.append(f"void {prefix}_{law.name}_defaults({prefix}_{law.name}_parameters *parameters);\n")
        parts += [_declaration(prefix, law.name, f) for f in law.functions]
    parts.append("#ifdef __cplusplus\n}\n#endif\n\n#endif\n")
    return "\n".join(parts)


def source(prefix: str, functions: Sequence[Function], law: Law | None = None) -> str:
    """Definitions, of the arm's functions or of one law's."""
    parts = [f'#include "{prefix}.h"\n\n#include <math.h>\n', HELPERS]
    name = law.name if law else ""
    if law and law.defaults:
        parts.append(_defaults(prefix, law))
    for f in functions:
        parts += [_values(prefix, name, f), _checked(prefix, name, f)]
    return "\n".join(parts)


def structs(law: Law) -> list[Struct]:
    """Each of a law's structures once."""
    found = {a.name: a for f in law.functions for a in f.arguments if isinstance(a, Struct)}
    return list(found.values())


def signature(prefix: str, law: str, f: Function, apart: bool = False) -> list[str]:
    """The arguments as C declares them; ``apart``: with what is changed in place as an input and an output of its own."""
    outputs = {a.name for a in f.outputs}
    inputs = {a.name for a in f.inputs}
    declared = [_declared(prefix, law, a, a.name in outputs and not apart) for a in f.inputs]
    declared += [
        _declared(prefix, law, a._replace(name=_next(a, inputs)), True)
        for a in f.outputs
        if apart or a.name not in inputs
    ]
    return declared


def kind(prefix: str, law: str, argument: Argument) -> str:
    """C type of an argument, or of its entries."""
    if not isinstance(argument, Struct):
        return "double"
    return f"{prefix}_{law}_{argument.name.removeprefix('next_')}"


def _next(argument: Argument, inputs: set[str]) -> str:
    return f"next_{argument.name}" if argument.name in inputs else argument.name


def _declared(prefix: str, law: str, argument: Argument, is_output: bool) -> str:
    const = "" if is_output else "const "
    if isinstance(argument, Struct):
        return f"{const}{kind(prefix, law, argument)} *{argument.name}"
    if argument.shape == ():
        return f"double *{argument.name}" if is_output else f"double {argument.name}"
    return f"{const}double {argument.name}[{argument.size}]"


def _struct(prefix: str, law: str, struct: Struct) -> str:
    members = [f"  double {f.name}{_extent(f)};" for f in struct.fields]
    width = max(map(len, members))
    lines = [f"{member:{width}} /* {_said(f)} */" for member, f in zip(members, struct.fields, strict=True)]
    body = "\n".join(lines)
    return f"/* {struct.says} */\ntypedef struct {{\n{body}\n}} {kind(prefix, law, struct)};\n"


def _extent(f: Field) -> str:
    return f"[{f.size}]" if f.shape else ""


def _said(f: Field) -> str:
    shape = f"{f.shape[0]} x {f.shape[1]}" if len(f.shape) == 2 else ""
    return "; ".join(filter(None, (shape, f.unit, f.says)))


def _declaration(prefix: str, law: str, f: Function) -> str:
    rows = [(f"{a.name}{_extent(a)}", _said(a)) for a in f.arguments if isinstance(a, Field)]
    width = max((len(name) for name, _ in rows), default=0)
    told = [f"  {name:{width}}  {text}" for name, text in rows]
    comment = _comment([*f.says.splitlines(), *told, counted(f.program)])
    return f"{comment}{_prototype('int', f'{prefix}_{f.name}', signature(prefix, law, f))};\n"


def _prototype(result: str, name: str, arguments: Sequence[str]) -> str:
    lines = [f"{result} {name}("]
    for k, argument in enumerate(arguments):
        text = argument + (", " if k + 1 < len(arguments) else ")")
        if len(lines[-1]) + len(text) > WIDTH + 1:
            lines.append("    ")
        lines[-1] += text
    return "\n".join(line.rstrip() for line in lines)


def counted(program: Program) -> str:
    """How many operations, and which."""
    operations = sorted(program.operations.items(), key=lambda item: (-item[1], item[0]))
    listed = ", ".join(f"{count} {op}" for op, count in operations)
    return f"{sum(program.operations.values())} operations" + (f": {listed}" if listed else "")


def _comment(lines: Sequence[str]) -> str:
    """Lines folded where they are long, those that are indented further in."""
    folded = []
    for line in lines:
        inner = " " * (len(line) - len(line.lstrip()))
        further = inner + "    " if inner else ""
        text = line.strip().replace("*/", "* /").replace("/*", "/ *")
        folded += textwrap.wrap(text, WIDTH, initial_indent=inner, subsequent_indent=further) or [""]
    return "/* " + "\n   ".join(folded).replace("   \n", "\n") + " */\n"


def _access(argument: Struct | None, field: Field, i: int, scalar: str = "") -> str:
    """C of one number; ``scalar``: before a single one that is no member."""
    name = f"{argument.name}->{field.name}" if argument else field.name
    if field.shape:
        return f"{name}[{i}]"
    return name if argument else f"{scalar}{name}"


def _values(prefix: str, law: str, f: Function) -> str:
    """The formula, without a look at its arguments."""
    given, inputs = list(fields(f.inputs)), {a.name for a in f.inputs}
    require_inputs(f.name, f.program, [x.size for _, x in given])
    outputs = [a._replace(name=_next(a, inputs)) for a in f.outputs]
    targets = [_access(struct, x, i, "*") for struct, x in fields(outputs) for i in range(x.size)]
    lines = statements(f.program, lambda k, i: _access(*given[k], i), targets)
    used = {node.place[0] for node in f.program.nodes if node.op == "input"}
    touched = {(given[k][0] or given[k][1]).name for k in used}
    lines += [f"(void){a.name};" for a in f.inputs if a.name not in touched]
    body = "\n".join(f"  {line}" for line in lines)
    prototype = _prototype("static void", f"{f.name}_values", signature(prefix, law, f, apart=True))
    return f"{prototype}\n{{\n{body}\n}}\n"


def _checked(prefix: str, law: str, f: Function) -> str:
    inputs = {a.name for a in f.inputs}
    in_place = [a for a in f.outputs if a.name in inputs]
    arguments = [a.name for a in f.inputs]
    arguments += [f"&{_next(a, inputs)}" if a.name in inputs else a.name for a in f.outputs]
    outside = [a for a in f.outputs if a.name not in inputs]
    next_state = [f"  {kind(prefix, law, a)} next_{a.name};" for a in in_place]
    results = [*_finite(outside, "", True), *_finite(in_place, "next_", True, ".")]
    lines = [
        *next_state,
        f"  int ok = {_all(list(_finite(f.inputs, '', False)), '  ')};",
        "  if (ok) {",
        f"    {f.name}_values({', '.join(arguments)});",
        f"    ok = {_all(results, '    ')};",
        "  }",
    ]
    lines += [f"  if (ok) *{a.name} = next_{a.name};" for a in in_place]
    zeros = [f"set_zero({_pointer(s, x, True)}, {x.size});" for s, x in fields(outside)]
    lines += ["  if (!ok) {", *(f"    {zero}" for zero in zeros), "  }"] if zeros else []
    lines.append(f"  return ok ? {prefix.upper()}_OK : {prefix.upper()}_NOT_FINITE;")
    prototype = _prototype("int", f"{prefix}_{f.name}", signature(prefix, law, f))
    return f"{prototype}\n{{\n" + "\n".join(lines) + "\n}\n"


def _all(checks: Sequence[str], indent: str) -> str:
    return f"\n{indent}    && ".join(checks)


def _pointer(struct: Struct | None, field: Field, is_output: bool, before: str = "", link: str = "->") -> str:
    if struct is None:
        return field.name if field.shape or is_output else f"&{field.name}"
    member = f"{before}{struct.name}{link}{field.name}"
    return member if field.shape else f"&{member}"


def _finite(arguments: Sequence[Argument], before: str, is_output: bool, link: str = "->") -> Iterator[str]:
    for struct, field in fields(arguments):
        yield f"all_finite({_pointer(struct, field, is_output, before, link)}, {field.size})"


def _defaults(prefix: str, law: Law) -> str:
    name = f"{prefix}_{law.name}"
    members = [f"    {_numbers(value)}, /* {key} */" for key, value in law.defaults.items()]
    listed = "\n".join(members)
    return (
        f"void {name}_defaults({name}_parameters *parameters)\n{{\n"
        f"  static const {name}_parameters exported = {{\n{listed}\n  }};\n  *parameters = exported;\n}}\n"
    )


def _numbers(value: np.ndarray) -> str:
    if not value.shape:
        return literal(float(value))
    return "{" + wrapped(np.ravel(value), "     ") + "}"


def wrapped(values: Sequence[float] | np.ndarray, indent: str, per_line: int = 6) -> str:
    """Numbers of C, some a line."""
    texts = [literal(float(x)) for x in values]
    rows = [", ".join(texts[k : k + per_line]) for k in range(0, len(texts), per_line)]
    return f",\n{indent}".join(rows)
