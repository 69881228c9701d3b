"""Compiled rollouts: many of them, searches by them, C for the robot, and what the machine makes of them."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TimeRemainingColumn
from rich.table import Table

from k1607_pin.cli.app import Lock, Robot, ToolFrame, console, finite, robot_called

if TYPE_CHECKING:
    pass


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Tell what compiled rollouts find on this machine, how fast they are, and why they are slow if they are.

    Example: k1607 doctor
    """
    from k1607_pin.compiled.doctor import diagnose

    found = diagnose()
    if as_json:
        print(json.dumps(asdict(found), indent=2))
        return
    table = Table(title="Compiled rollouts on this machine", show_header=False)
    for name, text in (
        ("versions", ", ".join(f"{name} {number}" for name, number in found.versions.items())),
        ("processor", f"{found.cpu}, {found.processors} to be used"),
        ("instructions", f"{found.instructions}, {found.lanes} rollouts side by side"),
        ("compiler", found.compiler),
        ("cache", f"{found.cache}, {found.cache_bytes / 1e6:.1f} MB{'' if found.cache_writable else ', not writable'}"),
        ("environment", ", ".join(f"{name}={x}" for name, x in found.environment.items()) or "nothing set"),
        ("agrees with simulate", f"to {found.apart:.0e}"),
        ("physics step", f"{found.step * 1e9:.0f} ns a rollout on one core, K-1607, Cartesian scheme"),
        ("verdict", "; ".join(found.verdict) or "as it should be"),
    ):
        table.add_row(name, text)
    console.print(table)


def bench(
    robot: Robot = "k1607",
    tool_frame: ToolFrame = None,
    lock: Lock = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Time compiled rollouts, dynamics and a control tick of an arm, beside Pinocchio's C++ in the same run: some seconds.

    `make bench` of a checkout measures more, MuJoCo among it.

    \b
    Examples:
        k1607 bench
        k1607 bench --robot panda --json
    """
    from k1607_pin.compiled.bench import bench as run

    arm = robot_called(robot, tool_frame=tool_frame, lock=lock)
    notes = Console(stderr=True, highlight=False)
    try:
        with notes.status("compiling") as status:
            found = run(arm, done=lambda work: status.update(f"timed: {work}"))
    except RuntimeError as error:
        raise ValueError(error) from None
    if as_json:
        print(json.dumps([line._asdict() for line in found], indent=2))
        return
    table = Table(title=f"{arm.name}: 100 Hz control, 1 kHz physics")
    for column in ("", "median", "operations", "G/s", "beside it", "times as long"):
        table.add_column(column, justify="left" if column in ("", "beside it") else "right")
    for line in found:
        per_second = f"{line.operations / line.seconds / 1e9:.1f}" if line.operations else ""
        operations = f"{line.operations:,}" if line.operations else ""
        ratio = "" if line.ratio is None else f"{line.ratio:.3g}"
        table.add_row(line.work, _duration(line.seconds), operations, per_second, line.beside, ratio)
    console.print(table)


def _duration(seconds: float) -> str:
    return f"{seconds * 1e9:.3g} ns" if seconds < 1e-6 else f"{seconds * 1e6:.3g} µs"


def sweep(
    case: Annotated[int, typer.Argument(help="1, the straight line, or 2, the circle.")] = 1,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=LOWER:UPPER:COUNT, a dimension of a grid; or drawn: NAME~uniform:LOWER:UPPER, "
            "NAME~loguniform:LOWER:UPPER, NAME~normal:MEAN:SIGMA. An array is scaled, NAME*=LOWER:UPPER:COUNT, or NAME[0,0]= "
            "and the like name its entries, NAME[:] all; so too with ~. Again for more parameters; a wrong name tells which "
            "there are."
        ),
    ] = None,
    n: Annotated[
        int | None,
        typer.Option("-n", help="Rollouts drawn, at each point of the grid if there is one; 1024 when left out."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of what is drawn; 0 when left out.")] = None,
    settings: Annotated[
        str, typer.Option(help="report: as published, 10 ms; recommended: ours, 1 kHz, full gravity.")
    ] = "report",
    store: Annotated[
        Path | None, typer.Option(help="Folder (zarr) for all results; the same command goes on with it.")
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="One a processor when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON instead of a table.")] = False,
) -> None:
    """Run a study case many times with other numbers, compiled, and tell how the errors spread.

    \b
    Examples:
        k1607 sweep 1 --vary payloads.0.payload.mass=0:9:10 --vary plant.viscous~uniform:5:15 -n 64
        k1607 sweep 1 --vary controller.beta_1=0:1e6:100 --store beta.zarr
        k1607 sweep 2 --vary controller.gains.K_p*=0.5:2:7 --vary controller.gains.K_d[0,0]=200:800:4
    """
    from concurrent.futures import ThreadPoolExecutor

    from k1607_pin.compiled.lanes import processors
    from k1607_pin.compiled.samples import Grid
    from k1607_pin.compiled.sweep import sweep as run
    from k1607_pin.report.cases import study_case
    from k1607_pin.report.sweeps import QUANTILES, names_of, parameters_of, summary

    study = study_case(case, settings)
    loop = study.rollouts(names_of(vary or ()))
    parameters = parameters_of(vary or (), 1024 if n is None else n, seed or 0, loop.now())
    notes, rate = Console(stderr=True, highlight=False), 0.0
    if isinstance(parameters, Grid) and parameters.each is None:
        for option, unused in (("-n", n), ("--seed", seed)):
            if unused is not None:
                size = math.prod(parameters.dims.values())
                notes.print(
                    f"{option} {unused} changes nothing: nothing is drawn, and the grid has {size:,} rollouts",
                    soft_wrap=True,
                )
    columns = ("{task.description}", BarColumn(), "{task.fields[rate]:,.0f} rollouts/s", TimeRemainingColumn())
    try:
        with Progress(*columns, console=notes, transient=True) as bar:
            task = bar.add_task(f"case {case}", total=None, rate=0.0)

            def progress(done: int, total: int, per_second: float, left: float) -> None:
                nonlocal rate
                rate = per_second
                bar.update(task, completed=done, total=total, rate=rate)

            found = run(
                loop,
                parameters,
                study.q0,
                executor=lambda: ThreadPoolExecutor(threads or processors()),
                store=store,
                progress=progress,
            )
    except KeyboardInterrupt:
        notes.print(
            f"stopped; what is done is in {store}, and the same command goes on from there"
            if store
            else "stopped; nothing is kept without --store FOLDER"
        )
        raise typer.Exit(130) from None
    rows, lost, counted = summary(found)
    total = found.failed_at.size
    if as_json:
        told = {
            "rollouts": total, "lost": lost, "rollouts_per_s": rate, "quantiles": QUANTILES, "counted": counted,
            "errors": {name: [finite(x) for x in row] for name, row in rows.items()},
        }  # fmt: skip
        print(json.dumps(told, indent=2))
        return
    many = f"{counted:,} of {total:,}" if counted < total else f"{total:,}"
    table = Table(title=f"Case {case}: {many} rollouts, the worst axis of each")
    for column in ("", *(f"{100 * x:g} %" for x in QUANTILES)):
        table.add_column(column, justify="right" if column else "left")
    for name, row in rows.items():
        table.add_row(name, *(f"{x:.3g}" for x in row))
    console.print(table)
    console.print(f"lost: {100 * lost:.2g} %; {rate:,.0f} rollouts/s", highlight=False)


def identify(
    budget: Annotated[int, typer.Option(help="Rollouts; two a set.")] = 100_000,
    seed: Annotated[int, typer.Option(help="The same seed, the same search.")] = 0,
    out: Annotated[Path, typer.Option(help="JSON file of the search; the same command goes on with it.")] = Path(
        "identified.json"
    ),
    anywhere: Annotated[
        bool, typer.Option("--anywhere", help="Begin at drawn postures; from the committed set when left out.")
    ] = False,
    limits: Annotated[
        bool | None,
        typer.Option(help="Keep to the assumed limits of the joint angles; as the committed set when left out."),
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="One a processor when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the set and its ratios as JSON.")] = False,
) -> None:
    """Search for what the report does not say of study cases 1 and 2: gains, posture, friction and so on, by its 16 errors.

    Stopped with Ctrl-C and called again, it goes on with the expedition that it was at; with a larger budget it goes further.

    \b
    Examples:
        k1607 identify --budget 20000
        k1607 identify --anywhere --limits --seed 1 --out within.json
    """
    from k1607_pin import data
    from k1607_pin.report.identify import identify as run
    from k1607_pin.report.published import WITHIN
    from k1607_pin.report.sensitivity import HEADER, ratios
    from k1607_pin.report.unknowns import NAMES, UNKNOWNS, values_of

    notes = Console(stderr=True, highlight=False)
    start = None if anywhere else data.load("study_cases")["report"]
    columns = ("{task.description}", BarColumn(), "{task.fields[told]}", TimeRemainingColumn())
    try:
        with Progress(*columns, console=notes, transient=True) as bar:
            task = bar.add_task("identify", total=budget, told="")

            def progress(count: int, worth: float) -> None:
                bar.update(task, completed=count, told=f"{count:,} rollouts, best {worth:.3f}")

            choice, search = run(budget, seed, start, limits, out, threads=threads, progress=progress)
    except KeyboardInterrupt:
        notes.print(f"stopped; what is done is in {out}, and the same command goes on from there")
        raise typer.Exit(130) from None
    found = ratios(choice)
    if as_json:
        told = {"rollouts": search.rollouts, "worth": search.best.worth, "ratios": [finite(float(x)) for x in found]}
        print(json.dumps(told | {"report": choice}, indent=2))
        return
    table = Table(title="Ours over published")
    for column in ("", "line", "circle"):
        table.add_column(column, justify="right" if column else "left")
    for name, *pair in zip(HEADER, found[:8], found[8:], strict=True):
        table.add_row(name, *(f"[{'green' if abs(x - 1) <= WITHIN else 'red'}]{x:.3f}[/]" for x in pair))
    console.print(table)
    values = ", ".join(
        f"{n} {x:.4g} {u.unit}".rstrip() for n, x, u in zip(NAMES, values_of(choice), UNKNOWNS, strict=True)
    )
    console.print(values, highlight=False)
    met, near = (int((np.abs(found - 1) <= share).sum()) for share in (WITHIN, 0.1))
    console.print(
        f"{met} of 16 within 25 % in magnitude, {near} within 10 %; {search.rollouts:,} rollouts; all of it: {out}",
        highlight=False,
    )


def export(
    out: Annotated[Path, typer.Argument(help="Folder for the C files; made if it is not there.")],
    robot: Robot = "k1607",
    tool_frame: ToolFrame = None,
    lock: Lock = None,
    law: Annotated[list[str] | None, typer.Option(help="cartesian, joint or hybrid; repeat for several.")] = None,
    function: Annotated[list[str] | None, typer.Option(help="Of the arm, e.g. jacobian; all when left out.")] = None,
    period: Annotated[float, typer.Option(help="Control period in ms, for which the laws' gains are made.")] = 1.0,
    prefix: Annotated[str | None, typer.Option(help="Of all names in C; the robot's name when left out.")] = None,
) -> None:
    """Write plain C99 of an arm's kinematics and dynamics, and of control laws, with a self-test that runs.

    \b
    Examples:
        k1607 export c --law cartesian
        k1607 export c --robot panda --law joint --law hybrid --function gravity_torque
        cmake -S c -B build && cmake --build build && ctest --test-dir build
    """
    from k1607_pin.compiled.export import export as write
    from k1607_pin.compiled.export.presets import law_of

    arm = robot_called(robot, tool_frame=tool_frame, lock=lock)
    laws = {name: law_of(arm, name, period * 1e-3) for name in law or ()}
    files = write(arm, out, laws, function or None, prefix)
    for file in files:
        console.print(f"wrote {file} ({file.stat().st_size:,} bytes)", highlight=False)
    sources = " ".join(file.name for file in files if file.suffix == ".c")
    console.print(
        f"To test it there: cc -std=c99 -O2 {sources} -lm -o selftest && ./selftest", highlight=False, soft_wrap=True
    )
