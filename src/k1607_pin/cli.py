"""The command line: `k1607`."""

import json
import os
import threading
import tomllib
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TimeRemainingColumn
from rich.table import Table

from k1607_pin.description.units import INCH, POUND

if TYPE_CHECKING:
    import xarray as xr

    from k1607_pin.arm.arm import Arm
    from k1607_pin.report.published import Comparison
    from k1607_pin.report.rows import Row

app = typer.Typer(
    help="The K-1607 and its 1990 NASA/CUA report, made to run.\n\nExample: k1607 equations",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # square brackets in the examples are TOML, not markup
)
console = Console()

VERDICT_STYLE = {"holds": "green", "definition": "dim", "misprint": "yellow", "gap": "magenta", "fails": "bold red"}


@app.command()
def urdf(
    out: Annotated[
        Path | None, typer.Option(help="Where to write it; urdf/k1607.urdf, or <name>.urdf with --dh.")
    ] = None,
    dh: Annotated[
        Path | None,
        typer.Option(help="Another arm: a TOML file with [dh] and, if you have them, [limits] and [[link]]."),
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; fail if the file is not up to date.")] = False,
) -> None:
    """Write a URDF from a modified Denavit-Hartenberg table: Table 1's, or yours.

    \b
    Examples:
        k1607 urdf --out k1607.urdf
        k1607 urdf --dh my_arm.toml --out my_arm.urdf

    \b
    where my_arm.toml holds, for two joints:
        [dh]
        units = { length = "m", angle = "deg" }
        rows = [[0, 0, 0.3], [-90, 0.1, 0]]   # alpha, a, d of eq. (2)
    """
    from k1607_pin.description import description
    from k1607_pin.description.urdf import to_urdf
    from k1607_pin.files import write_atomically

    arm = description.k1607() if dh is None else description.from_mapping(_read_toml(dh))
    text = to_urdf(arm)
    out = out or (Path("urdf/k1607.urdf") if dh is None else Path(f"{arm.name}.urdf"))
    if check:
        if not out.exists() or out.read_text() != text:
            raise ValueError(f"{out} is not what the data give: run `k1607 urdf --out {out}`")
        console.print(f"{out} is up to date")
        return
    write_atomically(out, text)
    console.print(f"wrote {out} ({len(text):,} bytes)")


@app.command()
def equations(
    numbers: Annotated[list[int] | None, typer.Argument(help="Which; all when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Check the report's numbered equations and print the verdicts.

    \b
    Examples:
        k1607 equations
        k1607 equations 8 28 --json
    """
    from k1607_pin.report.equations import check_all

    checked = check_all(numbers or ())
    if as_json:
        print(json.dumps([asdict(c) for c in checked], indent=2))
        return
    table = Table(title="The report's equations, run and checked", show_lines=False)
    for column, justify in (("", "right"), ("what it says", "left"), ("verdict", "left"), ("residual", "right")):
        table.add_column(column, justify=justify)  # type: ignore[arg-type]
    table.add_column("as printed", justify="right")
    table.add_column("implemented in, checked against", style="dim")
    for c in checked:
        printed = "lost" if c.verdict == "misprint" and c.printed_residual is None else _number(c.printed_residual)
        style = VERDICT_STYLE[c.verdict]
        table.add_row(
            f"({c.number})", c.says, f"[{style}]{c.verdict}[/]", _number(c.residual), printed, f"{c.where}: {c.how}"
        )
    console.print(table)
    for c in checked:
        for text in filter(None, (c.note, c.gap and f"Gap: {c.gap}")):
            console.print(f"  ({c.number}) {text}", style="dim", highlight=False)
    counts = {verdict: sum(c.verdict == verdict for c in checked) for verdict in VERDICT_STYLE}
    console.print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    if counts["fails"]:
        raise typer.Exit(1)


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for results.json, the figures and index.html.")] = Path("out"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON instead of a table.")] = False,
) -> None:
    """Reproduce the report's Parts 1-3 and study cases 1 and 2: its figures and numbers beside ours.

    Example: k1607 reproduce --out out
    """
    from k1607_pin.report.reproduce import reproduce as run

    with console.status("starting") as status:
        results, aims = run(out, status.update)
    if as_json:
        print(json.dumps([asdict(r) for r in results], indent=2))
        return
    _comparison("Parts 1-3 and study cases 1 and 2: published and ours", "published", results)
    _comparison("The study cases at 1 kHz in full gravity, our settings", "aim", aims)
    console.print(f"Figures and page: {out / 'index.html'}", highlight=False)


def _comparison(title: str, reference: str, rows: "list[Comparison]") -> None:
    table = Table(title=title)
    for column in ("quantity", reference, "ours", "unit", "ratio", "verdict"):
        table.add_column(column, justify="right" if column in (reference, "ours", "ratio") else "left")
    for r in rows:
        style = (
            "green"
            if r.verdict in ("met", "agrees")
            else "yellow"
            if r.verdict.startswith(("contradicts", "within"))
            else "bold red"
        )
        ratio = "" if r.ratio is None else f"{r.ratio:.3f}"
        table.add_row(r.quantity, str(r.published), f"{r.ours:.4g}", r.unit, ratio, f"[{style}]{r.verdict}[/]")
    console.print(table)


@app.command()
def simulate(
    case: Annotated[int, typer.Argument(help="1, the straight line, or 2, the circle.")] = 1,
    settings: Annotated[
        str | None,
        typer.Option(
            help="report: as published, 10 ms; recommended: ours, 1 kHz, full gravity. The latter for other robots."
        ),
    ] = None,
    robot: Annotated[
        str, typer.Option(help="k1607, a robot of example-robot-data such as panda, or a URDF file.")
    ] = "k1607",
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

    arm = None if robot == "k1607" else _robot(robot, 9.81 if gravity is None else gravity)
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


def _robot(name: str, gravity: float = 9.81) -> "Arm":
    """The K-1607, a robot of example-robot-data, or a URDF file; gravity in m/s^2 downwards."""
    from k1607_pin.arm.load import load_example, load_k1607, load_urdf

    down = (0.0, 0.0, -gravity)
    if name == "k1607":
        return load_k1607(gravity=down)
    return load_urdf(name, gravity=down) if name.endswith(".urdf") else load_example(name, gravity=down)


@app.command()
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
        print(json.dumps([{k: _finite(x) for k, x in asdict(row).items()} for row in rows], indent=2))
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


def _finite(x: object) -> object:
    """None for what JSON has no word for."""
    return None if isinstance(x, float) and not np.isfinite(x) else x


@app.command()
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


@app.command()
def sweep(
    case: Annotated[int, typer.Argument(help="1, the straight line, or 2, the circle.")] = 1,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=LOWER:UPPER:COUNT, a dimension of a grid; or drawn: NAME~uniform:LOWER:UPPER, "
            "NAME~loguniform:LOWER:UPPER, NAME~normal:MEAN:SIGMA. Again for more parameters; a wrong name tells which there are."
        ),
    ] = None,
    n: Annotated[int, typer.Option("-n", help="Rollouts drawn, at each point of the grid if there is one.")] = 1024,
    seed: Annotated[int, typer.Option(help="Of what is drawn.")] = 0,
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
    """
    from concurrent.futures import ThreadPoolExecutor

    from k1607_pin.compiled.lanes import processors
    from k1607_pin.compiled.sweep import sweep as run
    from k1607_pin.report.cases import study_case
    from k1607_pin.report.sweeps import QUANTILES, names_of, parameters_of, summary

    study = study_case(case, settings)
    loop = study.rollouts(names_of(vary or ()))
    parameters = parameters_of(vary or (), n, seed, loop.loop.parameters)
    notes, rate = Console(stderr=True, highlight=False), 0.0
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
            f"stopped; what is done is in {store}, and the same command goes on from there" if store else "stopped"
        )
        raise typer.Exit(130) from None
    rows, lost, counted = summary(found)
    total = found.failed_at.size
    if as_json:
        told = {
            "rollouts": total, "lost": lost, "rollouts_per_s": rate, "quantiles": QUANTILES, "counted": counted,
            "errors": {name: [_finite(x) for x in row] for name, row in rows.items()},
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


@app.command()
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
        bool | None, typer.Option(help="Keep to the assumed joint limits; as the committed set when left out.")
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
        told = {"rollouts": search.rollouts, "worth": search.best.worth, "ratios": [_finite(float(x)) for x in found]}
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
        f"{met} of 16 within 25 %, {near} within 10 %; {search.rollouts:,} rollouts; all of it: {out}", highlight=False
    )


@app.command()
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


@app.command()
def export(
    out: Annotated[Path, typer.Argument(help="Folder for the C files; made if it is not there.")],
    robot: Annotated[
        str, typer.Option(help="k1607, a robot of example-robot-data such as panda, or a URDF file.")
    ] = "k1607",
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

    arm = _robot(robot)
    laws = {name: law_of(arm, name, period * 1e-3) for name in law or ()}
    files = write(arm, out, laws, function or None, prefix)
    for file in files:
        console.print(f"wrote {file} ({file.stat().st_size:,} bytes)", highlight=False)
    sources = " ".join(file.name for file in files if file.suffix == ".c")
    console.print(
        f"To test it there: cc -std=c99 -O2 {sources} -lm -o selftest && ./selftest", highlight=False, soft_wrap=True
    )


@app.command()
def view(
    robot: Annotated[
        str, typer.Option(help="k1607, a robot of example-robot-data such as panda, or a URDF file.")
    ] = "k1607",
    html: Annotated[
        Path | None, typer.Option(help="Write one self-contained page to this file, and no server.")
    ] = None,
    pose: Annotated[
        str | None, typer.Option(help="Joint angles in degrees, comma-separated; each joint in turn when left out.")
    ] = None,
    frames: Annotated[bool, typer.Option(help="Show the frames.")] = True,
    host: Annotated[
        str, typer.Option(help="Address to serve on; the default lets only this machine in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port of the page; 0 takes a free one.")] = 0,
) -> None:
    """Show an arm in 3-D: live in the browser, or as a page that opens offline.

    \b
    Examples:
        k1607 view --html k1607.html
        k1607 view --robot panda
        k1607 view --pose 20,-30,10,80,0,60,0
    """
    from k1607_pin import view as viewer
    from k1607_pin.view.demo import each_joint_in_turn

    arm = _robot(robot)
    times, Q = each_joint_in_turn(arm) if pose is None else (None, _degrees(pose))
    if html is not None:
        path = viewer.save_html(arm, html, times, Q, frames=frames)
        console.print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB): open it in any browser", highlight=False)
        return
    with viewer.show(arm, times, Q, frames=frames, host=host, port=port) as live:
        console.print(f"{arm.name} at {live.url} - press Ctrl-C to stop", highlight=False)
        with suppress(KeyboardInterrupt):
            threading.Event().wait()


def _degrees(text: str) -> np.ndarray:
    try:
        return np.deg2rad([float(x) for x in text.split(",")])
    except ValueError:
        raise ValueError(f"--pose: expected numbers in degrees such as 20,-30,10,80,0,60,0, got {text!r}") from None


def _number(x: float | None) -> str:
    return "" if x is None else "0" if x == 0 else f"{x:.1e}"


def _read_toml(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"--dh: no file {path}") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"--dh: {path} is not TOML: {error}") from None


def main() -> None:
    """Entry point: bad input is one line on standard error, not a traceback."""
    try:
        app()
    except ModuleNotFoundError as error:
        Console(stderr=True).print(
            f"k1607: {error}; for the 3-D view: pip install 'k1607-pin[viewer]'", style="red", markup=False
        )
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ValueError, OSError) as error:
        Console(stderr=True).print(f"k1607: {error}", style="red", markup=False, highlight=False)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
