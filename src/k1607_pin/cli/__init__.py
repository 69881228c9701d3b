"""The command line: `k1607`."""

from rich.console import Console

from k1607_pin.cli import compiled, laws, report, view
from k1607_pin.cli.app import app, is_own

__all__ = ["app", "main"]

for command in (
    report.urdf, report.equations, report.reproduce, laws.simulate, laws.compare, laws.learning, laws.drift,
    compiled.sweep, compiled.identify, compiled.export, compiled.doctor, compiled.bench, view.view,
):  # fmt: skip
    app.command()(command)


def main() -> None:
    """Entry point: what the package itself refuses is a message on standard error, not a traceback."""
    try:
        app()
    except ModuleNotFoundError as error:
        Console(stderr=True, emoji=False).print(
            f"k1607: {error}; for the 3-D view: pip install 'k1607-pin[viewer]'", style="red", markup=False
        )
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except Exception as error:
        if not isinstance(error, ValueError | OSError) and not is_own(error):
            raise  # a fault of this package: its traceback is what a report of it needs
        Console(stderr=True, emoji=False).print(f"k1607: {error}", style="red", markup=False, highlight=False)
        raise SystemExit(2) from None
