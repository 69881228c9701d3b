"""The lower bounds of pyproject.toml as constraints for pip, "name==bound" a line, of all that the named extras need.

python tests/lowest_versions.py viewer sweep test > lowest.txt
"""

import re
import sys
import tomllib
from pathlib import Path


def lowest(extras: list[str]) -> list[str]:
    """A line for each dependency, of the package and of its extras."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(x for extra in extras for x in project["optional-dependencies"][extra])]
    found: dict[str, str] = {}
    for requirement in wanted:
        if requirement.startswith(project["name"]):
            continue
        name, bound = re.match(r"([A-Za-z0-9._-]+)(?:\[.*\])?>=([0-9.]+)", requirement).groups()
        if found.setdefault(name, bound) != bound:
            raise SystemExit(f"{name}: expected one lower bound, got {found[name]} and {bound}")
    return [f"{name}=={bound}" for name, bound in found.items()]


if __name__ == "__main__":
    print("\n".join(lowest(sys.argv[1:])))
