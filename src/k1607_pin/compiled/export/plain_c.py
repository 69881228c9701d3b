"""Programs as C99 that can be read: scalar expressions of named inputs, and libm."""

from collections import Counter
from collections.abc import Callable, Sequence

from k1607_pin.compiled.emit import BINARY, COMPARISONS, LIBM, literal
from k1607_pin.compiled.program import TRIVIAL, Program

LONGEST = 70  # characters of an expression that becomes part of another
ATOM, UNARY, PRODUCT, SUM, CHOICE = range(5)  # how loosely an expression binds
STRENGTH = {"mul": PRODUCT, "div": PRODUCT, "add": SUM, "sub": SUM}
LOGIC = {"and": "&&", "or": "||"}
TRUTHS = {*COMPARISONS, *LOGIC, "not"}
TWICE = ("sq", "twice", "sign", "fmin", "fmax")


def statements(program: Program, places: Callable[[int, int], str], targets: Sequence[str]) -> list[str]:
    """One line of C each: constants w0, w1, ... for what is used more than once, then the assignments to the outputs.

    Parameters
    ----------
    places : number of an input and of its element -> how C calls it; targets : what C assigns the elements of all outputs to.
    """
    text = _Expressions(program, places)
    results = [node for output in program.outputs for node in output]
    text.lines += [f"{name} = {text.of(node, CHOICE)};" for name, node in zip(targets, results, strict=True)]
    return text.lines


class _Expressions:
    """Of every node, its C: a name, or an expression where it is used but once and is short."""

    def __init__(self, program: Program, places: Callable[[int, int], str]) -> None:
        self.lines: list[str] = []
        self._nodes, self._places = program.nodes, places
        self._text: list[str] = []
        self._weakest: list[int] = []
        uses = Counter(a for node in program.nodes for a in node.args for _ in range(1 + (node.op in TWICE)))
        uses.update(i for output in program.outputs for i in output)
        for i, node in enumerate(program.nodes):
            text, weakest = self._expression(i)
            if node.op not in TRIVIAL and (uses[i] > 1 or len(text) > LONGEST):
                self.lines.append(f"const double w{i} = {text};")
                text, weakest = f"w{i}", ATOM
            self._text.append(text)
            self._weakest.append(weakest)

    def of(self, i: int, strength: int, last: bool = False) -> str:
        """Node i where operations of at most this strength may stand; ``last``: to the right of a minus, say."""
        text = self._text[i]
        bare = self._weakest[i] < strength or (self._weakest[i] == strength and not last)
        return text if bare and not (last and text.startswith("-")) else f"({text})"

    def condition(self, i: int) -> str:
        """Node i as a truth value."""
        is_truth = self._nodes[i].op in TRUTHS and self._text[i] != f"w{i}"
        return self._truth(i) if is_truth else f"{self.of(i, SUM)} != 0.0"

    def _truth(self, i: int) -> str:
        op, a = self._nodes[i].op, self._nodes[i].args
        if op in COMPARISONS:
            return f"{self.of(a[0], SUM)} {COMPARISONS[op]} {self.of(a[1], SUM, last=True)}"
        if op in LOGIC:
            return f"({self.condition(a[0])}) {LOGIC[op]} ({self.condition(a[1])})"
        return f"!({self.condition(a[0])})"

    def _expression(self, i: int) -> tuple[str, int]:
        node = self._nodes[i]
        op, a = node.op, node.args
        if op == "const":
            text = literal(node.value)
            return text, UNARY if text.startswith("-") else ATOM
        if op == "input":
            return self._places(*node.place), ATOM
        if op in BINARY:
            strength = STRENGTH[op]
            return f"{self.of(a[0], strength)} {BINARY[op]} {self.of(a[1], strength, last=True)}", strength
        if op == "sq":
            return f"{self.of(a[0], ATOM)} * {self.of(a[0], ATOM)}", PRODUCT
        if op == "twice":
            return f"2.0 * {self.of(a[0], ATOM)}", PRODUCT
        if op == "neg":
            return f"-{self.of(a[0], ATOM)}", UNARY
        if op == "inv":
            return f"1.0 / {self.of(a[0], PRODUCT, last=True)}", PRODUCT
        if op == "assign":
            return self._text[a[0]], self._weakest[a[0]]
        if op == "if_else_zero":
            return f"{self.condition(a[0])} ? {self.of(a[1], SUM)} : 0.0", CHOICE
        if op == "sign":
            x = self.of(a[0], ATOM)
            return f"{x} > 0.0 ? 1.0 : {x} < 0.0 ? -1.0 : {x}", CHOICE
        if op in ("fmin", "fmax"):  # NaN where one is NaN, unlike C's
            x, y, sign = self.of(a[0], SUM), self.of(a[1], SUM, last=True), "<" if op == "fmin" else ">"
            return f"{x} {sign} {y} || {x} != {x} ? {x} : {y}", CHOICE
        if op == "constpow":
            return f"pow({self.of(a[0], CHOICE)}, {self.of(a[1], CHOICE)})", ATOM
        if op in LIBM:
            return f"{op}({', '.join(self.of(k, CHOICE) for k in a)})", ATOM
        if op in TRUTHS:
            return f"{self._truth(i)} ? 1.0 : 0.0", CHOICE
        raise NotImplementedError(f"operation {op!r} has no C")
