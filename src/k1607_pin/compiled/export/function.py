"""What is exported: C functions of named arguments, the program of each, and states at which its results are known."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from k1607_pin.compiled.program import Program


class Field(NamedTuple):
    """Numbers with a name: an argument of a function, or a member of a structure."""

    name: str
    shape: tuple[int, ...]
    unit: str
    says: str = ""

    @property
    def size(self) -> int:
        """How many numbers."""
        return int(np.prod(self.shape))


class Struct(NamedTuple):
    """An argument that is a structure of numbers."""

    name: str
    fields: tuple[Field, ...]
    says: str


Argument = Field | Struct


class Case(NamedTuple):
    """One state at which a function is known."""

    given: np.ndarray
    """All that it takes, in the order of the arguments"""
    expected: np.ndarray
    """All that it gives"""


class Function(NamedTuple):
    """A C function ``int <robot>_<name>(inputs, outputs)``; an argument that is both, under one name, is changed in place."""

    name: str
    says: str
    """For the header"""
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    program: Program
    """Its inputs and outputs are the fields of the arguments, in order."""
    cases: Sequence[Case]
    """From Pinocchio, or from the controller itself, on floats; `completed` adds others"""
    tolerances: tuple[float, ...] = ()
    """Of each output's fields: how far off C may be, as a share of what `scale_of` measures by"""

    @property
    def arguments(self) -> list[Argument]:
        """Each once."""
        names = {argument.name for argument in self.inputs}
        return [*self.inputs, *(argument for argument in self.outputs if argument.name not in names)]


def fields(arguments: Sequence[Argument]) -> Iterator[tuple[Struct | None, Field]]:
    """All fields in order, each with the structure that it is in."""
    for argument in arguments:
        if isinstance(argument, Struct):
            yield from ((argument, field) for field in argument.fields)
        else:
            yield None, argument


def size(arguments: Sequence[Argument]) -> int:
    """How many numbers there are in all."""
    return sum(field.size for _, field in fields(arguments))
