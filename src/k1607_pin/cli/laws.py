"""Control laws: the study cases, laws compared, gains that drift."""

import json
import os
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from k1607_pin.cli.app import Lock, Robot, ToolFrame, console, finite, robot_called
from k1607_pin.description.units import INCH, POUND

if TYPE_CHECKING:
    import xarray as xr

    from k1607_pin.arm.arm import Arm
    from k1607_pin.report.rows import Row


def simulate(
    case: Annotated[int, typer.Argument(help="1, the straight line, or 2, the circle.")] = 1,
    settings: Annotated[
        str | None,
        typer.Option(
            help="report: as published, 10 ms; recommended: ours, 1 kHz, full gravity. The latter for other robots."
        ),
    ] = None,
    robot: Robot = "k1607",
    tool_frame: ToolFrame = None,
    lock: Lock = None,
    payload: Annotated[
        float | None, typer.Option(help="lb, carried in the middle third; 10 for the K-1607 when left out.")
    ] = None,
    gravity: Annotated[float | None, typer.Option(help="m/s^2 downwards; the settings' own when left out.")] = None,
    period: Annotated[float | None, typer.Option(help="Control period in ms; the settings' own when left out.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for run.nc (the log, for xarray) and the figures.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write an animation that opens offline to this file.")] = None,
    show: Annotated[bool, typer.Option("--show", help="Show the animation live in the browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the errors as JSON instead of a table.")] = False,
) -> None:
    """Run study case 1 or 2 with the Cartesian adaptive scheme, and tell, draw or show how it went.

    \b
    Examples:
        k1607 simulate 1
        k1607 simulate 2 --settings recommended --payload 20 --out run
        k1607 simulate 1 --robot panda --html panda.html
        k1607 simulate 1 --settings recommended --gravity 1.62 --show
    """
    from k1607_pin.report.cases import study_case
    from k1607_pin.report.runs import write_run
    from k1607_pin.simulation.simulate import SimulationError

    own = robot == "k1607" and not (tool_frame or lock)  # the case as published
    arm = None if own else robot_called(robot, 9.81 if gravity is None else gravity, tool_frame, lock)
    mass = None if payload is None else payload * POUND
    settings = settings or ("report" if arm is None else "recommended")
    study = study_case(
        case, settings, arm, payload=mass, gravity=None if arm else gravity, control_period=period and period * 1e-3
    )
    lost = None
    try:
        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(f"case {case}, {study.law.arm.name}", total=1.0)
            run = study.run(lambda share: bar.update(task, completed=share))
    except SimulationError as error:
        lost, run = error, error.log
    rows = _errors(run)
    if as_json:
        print(json.dumps({"lost_at_s": lost and lost.time, "errors": rows}, indent=2))
    else:
        table = Table(
            title=f"Case {case}, {study.law.arm.name}, {1e3 * study.law.period:g} ms, {study.duration:g} s: errors"
        )
        for column in ("", "max", "RMS", "unit"):
            table.add_column(column, justify="left" if column in ("", "unit") else "right")
        for row in rows:
            table.add_row(str(row["error"]), f"{row['max']:.4g}", f"{row['rms']:.4g}", str(row["unit"]))
        console.print(table)
    notes = Console(stderr=as_json, highlight=False)
    if out is not None:
        write_run(out, run, f"Case {case}, {study.law.arm.name}")
        notes.print(f"Log and figures: {out}")
    if html is not None or show:
        _animate(study.law.arm, run, html, show, notes)
    if lost:
        raise ValueError(str(lost))


def _errors(run: "xr.Dataset") -> list[dict[str, float | str]]:
    """Largest and RMS error in each direction, in, in/s, degrees."""
    from k1607_pin.report.published_cases import statistic

    rows: list[dict[str, float | str]] = []
    for variable, per in (("error", ""), ("error_rate", "/s")):
        for direction in ("x", "y", "z", "rx", "ry", "rz"):
            scale, unit = (180 / np.pi, "deg") if direction.startswith("r") else (1 / INCH, "in")
            largest, rms = (scale * statistic(run, variable, direction, kind) for kind in ("max", "rms"))
            name = f"about {direction[1]}" if direction.startswith("r") else direction
            rows.append({"error": name + (" rate" if per else ""), "max": largest, "rms": rms, "unit": unit + per})
    return rows


def _animate(arm: "Arm", run: "xr.Dataset", html: Path | None, show: bool, notes: Console) -> None:
    from k1607_pin import view as viewer

    if html is not None:
        path = viewer.save_html(arm, html, run)
        notes.print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB): open it in any browser")
    if show:
        with viewer.show(arm, run) as live:
            notes.print(f"{arm.name} at {live.url} - press Ctrl-C to stop")
            with suppress(KeyboardInterrupt):
                threading.Event().wait()


def compare(
    out: Annotated[Path, typer.Option(help="Folder for comparison.csv, its table and figures.")] = Path("out"),
    case: Annotated[
        list[int] | None, typer.Option(help="1, the straight line, or 2, the circle; both when left out.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="At 10 ms alone, with a right model and a light one.")] = False,
    jobs: Annotated[int | None, typer.Option(help="Processes; one a core when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every run as JSON instead of the best.")] = False,
) -> None:
    """Run the adaptive schemes and the textbook's laws under the same troubles, and tell which law does best where.

    Stopped with Ctrl-C and called again, it goes on: runs that comparison.csv has are not made again. Delete it to begin anew.

    \b
    Examples:
        k1607 compare --quick
        k1607 compare --out out
        k1607 compare --case 1 --json
    """
    from k1607_pin.report.case_figures import CASES
    from k1607_pin.report.comparison import TROUBLES, compare
    from k1607_pin.report.comparison_figures import write_comparison
    from k1607_pin.report.joint_cases import figure_joint_case, joint_case
    from k1607_pin.report.runs import write_figure

    cases = tuple(case or CASES)
    conditions: dict[str, Any] = {"periods": (0.01,), "troubles": TROUBLES[:2]} if quick else {}
    notes, file = Console(stderr=True, highlight=False), out / "comparison.csv"
    try:
        with Progress(console=notes, transient=True) as bar:
            task = bar.add_task("comparing", total=1.0)
            rows = list(
                compare(
                    cases=cases,
                    **conditions,
                    progress=lambda share: bar.update(task, completed=share),
                    file=file,
                    jobs=jobs if jobs is not None else os.cpu_count() or 1,
                )
            )
    except KeyboardInterrupt:
        notes.print(f"stopped; what is done is in {file}, and the same command goes on from there")
        raise typer.Exit(130) from None
    write_comparison(out, rows)
    for number in () if quick else cases:
        title = f"Case {number}, {CASES[number]}: joint-space scheme, 1 kHz, full gravity"
        write_figure(out / f"joint-case-{number}", figure_joint_case(joint_case(number), title))
    if as_json:
        print(json.dumps([{k: finite(x) for k, x in asdict(row).items()} for row in rows], indent=2))
    else:
        _best(rows)
    notes.print(f"Every run: {file}; table and figures: {out / 'comparison.md'}, {out / 'comparison.png'}")


def _best(rows: "list[Row]") -> None:
    from k1607_pin.report.comparison_figures import best

    table = Table(title="The best under each condition, and what is within 2 % of it")
    for column in ("condition", "law", "RMS distance, mm"):
        table.add_column(column, justify="right" if column.startswith("RMS") else "left")
    for condition, winners in best(rows).items():
        first = f"{1e3 * winners[0].rms:.3g}" if winners else ""
        table.add_row(condition, ", ".join(row.law for row in winners) or "none", first)
    console.print(table)


def learning(
    case: Annotated[int, typer.Argument(help="1, the straight line, or 2, the circle.")] = 1,
    law: Annotated[
        str, typer.Option(help="recommended, or a law of `k1607 compare` that learns, such as 'joint adaptive + g'.")
    ] = "recommended",
    period: Annotated[float, typer.Option(help="Control period in ms; of recommended settings 1 alone.")] = 1.0,
    hold: Annotated[
        float | None, typer.Option(help="s: hold still for so long instead, the payload in the middle third.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for learning.nc (for xarray) and the figure.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the curve as JSON instead of a table.")] = False,
) -> None:
    """Sweep a law's learning rate from none to where the loop is lost, in compiled rollouts, and tell what learning earns.

    \b
    Examples:
        k1607 learning 1
        k1607 learning 2 --law "joint adaptive + g" --period 10 --out learning
        k1607 learning 1 --hold 60
    """
    from k1607_pin.files import write_atomically
    from k1607_pin.report.cases import study_case
    from k1607_pin.report.laws import LAWS
    from k1607_pin.report.learning import compared, holding, learning_curve
    from k1607_pin.report.learning_figure import figure_learning
    from k1607_pin.report.runs import write_figure

    if law != "recommended" and law not in LAWS:
        raise ValueError(f"--law: expected recommended or one of {', '.join(LAWS)}, got {law!r}")
    if law == "recommended":
        study = study_case(case, "recommended", control_period=period * 1e-3)
    else:
        study = compared(law, case, period * 1e-3)
    curve = learning_curve(study if hold is None else holding(study, hold))
    names = ("factor", "rate", "rms", "largest", "holds", "lost")
    rows = [
        dict(zip(names, row, strict=True)) for row in zip(*(curve[name].values.tolist() for name in names), strict=True)
    ]
    if as_json:
        told = {name: finite(float(curve.attrs[name])) for name in ("own", "holds_to", "lost_from", "bound")}
        print(json.dumps(told | {"rates": [{k: finite(x) for k, x in row.items()} for row in rows]}, indent=2))
    else:
        table = Table(title=f"Case {case}, {law}: RMS distance of the tool over the law's learning rate")
        for column in ("rate, 1/s", "of its own", "RMS, mm", "of none", ""):
            table.add_column(column, justify="right" if column else "left")
        for row in rows:
            verdict = "" if row["holds"] else "lost" if row["lost"] else "undecided"
            numbers = (f"{1e3 * row['rms']:.4g}", f"{row['rms'] / rows[0]['rms']:.3f}") if not row["lost"] else ("", "")
            table.add_row(f"{row['rate']:.3g}", f"{row['factor']:.3g}", *numbers, verdict)
        console.print(table)
        console.print(
            f"Its own rate is {curve.own:.3g} /s. Holds up to {curve.holds_to:.3g} /s, is lost from {curve.lost_from:.3g} /s on: "
            f"the tool more than {1e3 * curve.bound:.3g} mm off its path, or the numbers run away.",
            highlight=False,
        )
    if out is not None:
        write_atomically(out / "learning.nc", bytes(curve.astype(float).to_netcdf()))
        write_figure(out / "learning", figure_learning({f"case {case}": {law: curve}}))
        Console(stderr=True, highlight=False).print(f"Curve and figure: {out / 'learning.nc'}, {out / 'learning.png'}")


def drift(
    out: Annotated[Path, typer.Option(help="Folder for gain-drift.nc (for xarray) and the figure.")] = Path("out"),
    minutes: Annotated[float, typer.Option(help="How long the arm holds still.")] = 10.0,
    whole_arm: Annotated[
        bool, typer.Option("--whole-arm", help="Nothing linear: the whole arm, which takes some ten times as long.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what is left at the end as JSON.")] = False,
) -> None:
    """Hold still with noisy sensors, and see the gains of the joint-space scheme drift, with and without remedies.

    \b
    Examples:
        k1607 drift --minutes 0.5
        k1607 drift --out out
    """
    from k1607_pin.arm.load import load_k1607
    from k1607_pin.files import write_atomically
    from k1607_pin.report.case_figures import POSTURE_DEG
    from k1607_pin.report.gain_drift import figure_drift, gain_drift, outcome
    from k1607_pin.report.runs import write_figure

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("holding still", total=1.0)
        result = gain_drift(
            load_k1607(),
            np.deg2rad(POSTURE_DEG),
            duration=60 * minutes,
            whole_arm=whole_arm,
            progress=lambda share: bar.update(task, completed=share),
        )
    write_atomically(out / "gain-drift.nc", bytes(result.to_netcdf()))
    write_figure(out / "gain-drift", figure_drift(result))
    rows = outcome(result)
    if as_json:
        print(json.dumps(rows, indent=2))
    else:
        table = Table(title=f"After {minutes:g} min of holding still")
        for column in ("option", "K_p over K_p(0)", "K_d over K_d(0)", "error, mrad", ""):
            table.add_column(column, justify="right" if column not in ("option", "") else "left")
        for row in rows:
            end = "" if row["lost_after_s"] is None else f"lost after {row['lost_after_s'] / 60:.2g} min"
            table.add_row(row["option"], f"{row['K_p']:.4f}", f"{row['K_d']:.4f}", f"{1e3 * row['error_rad']:.3g}", end)
        console.print(table)
    Console(stderr=True, highlight=False).print(f"Log and figure: {out / 'gain-drift.nc'}, {out / 'gain-drift.png'}")
