"""The self-test of exported C: each function against what is known of it, and against arguments that are not finite."""

from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from k1607_pin.compiled.emit import literal
from k1607_pin.compiled.export.c import kind, wrapped
from k1607_pin.compiled.export.function import Argument, Function, Struct, fields, size
from k1607_pin.compiled.export.known import NOTHING, SHARE
from k1607_pin.compiled.export.law import Law

OTHER = """\
/* Whether a law's default is another number than it was exported with. */
static int other(const char *function, const char *name, const double *is, const double *known, int size)
{
  for (int i = 0; i < size; i++)
    if (!(is[i] == known[i])) {
      printf("FAILED  %s: %s is not as exported\\n", function, name);
      return 1;
    }
  return 0;
}
"""


def selftest(prefix: str, functions: Sequence[Function], laws: Sequence[Law]) -> str:
    """A C program that says what it finds, and fails if something is not as it is known."""
    everything = [("", f) for f in functions] + [(law.name, f) for law in laws for f in law.functions]
    most = max(max(size(f.inputs), size(f.outputs)) for _, f in everything)
    parts = [
        f'#include "{prefix}.h"\n',
        f"#define MOST {most}\n#define MOST_IN_ALL {max(len(f.cases) * size(f.outputs) for _, f in everything)}\n"
        f"#define SHARE {literal(SHARE)}\n#define NOTHING {literal(NOTHING)}\n",
        (files("k1607_pin.compiled.export") / "selftest.c").read_text(),
    ]
    parts += [_case(prefix, law, f) for law, f in everything]
    if any(law.defaults for law in laws):
        parts.append(OTHER)
    parts += [_defaults(prefix, law) for law in laws if law.defaults]
    rows = ",\n".join(_row(prefix, f) for _, f in everything)
    parts.append(f"static const Function functions[] = {{\n{rows}\n}};\n")
    parts.append(
        "int main(void)\n{\n"
        "  const int count = (int)(sizeof functions / sizeof functions[0]);\n  int failed = 0;\n"
        "  for (int k = 0; k < count; k++) failed += failures(functions + k);\n"
        + "".join(f"  failed += {law.name}_defaults_differ();\n" for law in laws if law.defaults)
        + f'  printf("{prefix}: %d functions, %d failures\\n", count, failed);\n'
        "  return failed != 0;\n}\n"
    )
    return "\n".join(parts)


def call(prefix: str, law: str, f: Function, name: str) -> str:
    """A C function ``name(in, out)`` that takes and gives all numbers in a row."""
    lines = []
    for a in f.arguments:
        extent = f"[{a.size}]" if not isinstance(a, Struct) and a.shape else ""
        lines.append(f"  {kind(prefix, law, a)} {a.name}{extent};")
    lines.append("  int status;")
    lines += _copied(f.inputs, "memcpy({there}, in + {first}, sizeof {plain});")
    outputs = {a.name for a in f.outputs}
    arguments = [
        a.name if _is_array(a) or (not isinstance(a, Struct) and a.name not in outputs) else f"&{a.name}"
        for a in f.arguments
    ]
    fresh = [a for a in f.outputs if a.name not in {b.name for b in f.inputs}]
    lines += [f"  memset(&{a.name}, 85, sizeof {a.name});" for a in fresh]  # so that what is not set is seen
    lines.append(f"  status = {prefix}_{f.name}({', '.join(arguments)});")
    lines += _copied(f.outputs, "memcpy(out + {first}, {there}, sizeof {plain});")
    lines.append("  return status;")
    return f"static int {name}(const double *in, double *out)\n{{\n" + "\n".join(lines) + "\n}\n"


def _is_array(a: Argument) -> bool:
    return not isinstance(a, Struct) and bool(a.shape)


def _copied(arguments: Sequence[Argument], form: str) -> list[str]:
    lines, first = [], 0
    for struct, field in fields(arguments):
        plain = f"{struct.name}.{field.name}" if struct else field.name
        lines.append("  " + form.format(there=plain if field.shape else f"&{plain}", first=first, plain=plain))
        first += field.size
    return lines


def _case(prefix: str, law: str, f: Function) -> str:
    places = {}
    first = 0
    for struct, field in fields(f.inputs):
        places[struct and struct.name, field.name] = first
        first += field.size
    results = ", ".join(
        f'{{"{field.name}", {field.size}, {places.get((struct and struct.name, field.name), -1)}, {literal(tolerance)}}}'
        for (struct, field), tolerance in zip(fields(f.outputs), f.tolerances, strict=True)
    )
    given, expected = (np.array([case[k] for case in f.cases]) for k in (0, 1))
    return "\n".join(
        [
            call(prefix, law, f, f"call_{f.name}"),
            f"static const Result {f.name}_results[] = {{{results}}};",
            *(
                f"static const double {f.name}_{name}[{x.size}] = {{\n  {wrapped(x.ravel(), '  ')}\n}};"
                for name, x in (("given", given), ("expected", expected))
            ),
            "",
        ]
    )


def _defaults(prefix: str, law: Law) -> str:
    """A C function that tells whether a law's default parameters are other ones."""
    type_ = f"{prefix}_{law.name}_parameters"
    lines = [f"static int {law.name}_defaults_differ(void)", "{", f"  {type_} is;", "  int differ = 0;"]
    lines.append(f"  {prefix}_{law.name}_defaults(&is);")
    for name, value in law.defaults.items():
        there = f"is.{name}" if np.shape(value) else f"&is.{name}"
        lines.append("  {")
        lines.append(f"    static const double known[] = {{\n      {wrapped(np.ravel(value), '      ')}\n    }};")
        lines.append(
            f'    differ += other("{prefix}_{law.name}_defaults", "{name}", {there}, known, {np.size(value)});'
        )
        lines.append("  }")
    return "\n".join([*lines, "  return differ;", "}", ""])


def _row(prefix: str, f: Function) -> str:
    results = len(list(fields(f.outputs)))
    return (
        f'  {{"{prefix}_{f.name}", call_{f.name}, {size(f.inputs)}, {size(f.outputs)}, {len(f.cases)}, {results}, '
        f"{f.name}_given, {f.name}_expected, {f.name}_results}}"
    )
