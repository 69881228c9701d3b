"""The report: its table as a URDF, its equations, and what becomes of its published results."""

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from k1607_pin.cli.app import console

if TYPE_CHECKING:
    from k1607_pin.report.published import Comparison


VERDICT_STYLE = {"holds": "green", "definition": "dim", "misprint": "yellow", "gap": "magenta", "fails": "bold red"}


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
    from k1607_pin.files import plain_name, write_atomically

    arm = description.k1607() if dh is None else description.from_mapping(_read_toml(dh))
    text = to_urdf(arm)
    out = out or (Path("urdf/k1607.urdf") if dh is None else Path(f"{plain_name(arm.name, 'name in ' + str(dh))}.urdf"))
    if check:
        if not out.exists() or out.read_text() != text:
            raise ValueError(f"{out} is not what the data give: run `k1607 urdf --out {out}`")
        console.print(f"{out} is up to date")
        return
    write_atomically(out, text)
    console.print(f"wrote {out} ({len(text):,} bytes)")


def _read_toml(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"--dh: no file {path}") from None
    except OSError as error:
        raise ValueError(f"--dh: {path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"--dh: {path} is not TOML: {error}") from None


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


def _number(x: float | None) -> str:
    return "" if x is None else "0" if x == 0 else f"{x:.1e}"


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
            if r.verdict.startswith(("contradicts", "met in"))
            else "bold red"
        )
        ratio = "" if r.ratio is None else f"{r.ratio:.3f}"
        table.add_row(r.quantity, str(r.published), f"{r.ours:.4g}", r.unit, ratio, f"[{style}]{r.verdict}[/]")
    console.print(table)
