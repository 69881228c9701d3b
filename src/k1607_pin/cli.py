"""The command line: `k1607`."""

import json
import threading
import tomllib
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

app = typer.Typer(
    help="The K-1607 and its 1990 NASA/CUA report, made to run.\n\nExample: k1607 equations",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # square brackets in the examples are TOML, not markup
)
console = Console()

VERDICT_STYLE = {"holds": "green", "definition": "dim", "misprint": "yellow", "fails": "bold red"}


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
        if c.note:
            console.print(f"  ({c.number}) {c.note}", style="dim", highlight=False)
    counts = {verdict: sum(c.verdict == verdict for c in checked) for verdict in VERDICT_STYLE}
    console.print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    if counts["fails"]:
        raise typer.Exit(1)


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for results.json, the figures and index.html.")] = Path("out"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON instead of a table.")] = False,
) -> None:
    """Reproduce the report's Parts 1-3: its figures and numbers beside ours.

    Example: k1607 reproduce --out out
    """
    from k1607_pin.report.reproduce import reproduce as run

    with console.status("starting") as status:
        results = run(out, status.update)
    if as_json:
        print(json.dumps([asdict(r) for r in results], indent=2))
        return
    table = Table(title="Parts 1-3: published and ours")
    for column in ("quantity", "published", "ours", "unit", "ratio", "verdict"):
        table.add_column(column, justify="right" if column in ("published", "ours", "ratio") else "left")
    for r in results:
        style = (
            "green"
            if r.verdict in ("met", "agrees")
            else "yellow"
            if r.verdict.startswith("contradicts")
            else "bold red"
        )
        ratio = "" if r.ratio is None else f"{r.ratio:.3f}"
        table.add_row(r.quantity, str(r.published), f"{r.ours:.4g}", r.unit, ratio, f"[{style}]{r.verdict}[/]")
    console.print(table)
    console.print(f"Figures and page: {out / 'index.html'}", highlight=False)


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
    from k1607_pin.arm.load import load_example, load_k1607, load_urdf
    from k1607_pin.view.demo import each_joint_in_turn

    arm = load_k1607() if robot == "k1607" else load_urdf(robot) if robot.endswith(".urdf") else load_example(robot)
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
    except (ValueError, OSError) as error:
        Console(stderr=True).print(f"k1607: {error}", style="red", markup=False, highlight=False)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
