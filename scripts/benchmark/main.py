"""Benchmarks of head_tracking; each writes one table of docs/benchmarks.md."""

import argparse
import re
from pathlib import Path
from pkgutil import resolve_name

RESULTS = Path(__file__).parents[2] / "docs" / "benchmarks.md"

# Loaded on demand, because some need further libraries.
BENCHMARKS = {
    **{
        name: f"{name}:{name}"
        for name in (
            "bus", "calibration", "faces", "identity", "pointing",
            "run", "target_path", "tracking", "transforms", "vision",
        )
    },
    "camera-delay": "calibration:camera_delay",
    "crash": "crash:killed",
    "page-open": "page:left_open",
    "page-stop": "page:stopped",
}  # fmt: skip


def write(name: str, table: str) -> None:
    """Write a table between its marks in docs/benchmarks.md."""
    text = RESULTS.read_text()
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    assert marks.search(text), f"{RESULTS} has no marks for {name}"
    RESULTS.write_text(marks.sub(lambda match: f"{match[1]}{table}\n{match[2]}", text))


def main() -> None:
    """Run one benchmark and write its table."""
    parser = argparse.ArgumentParser(prog="scripts/benchmark/measure", description=__doc__)
    parser.add_argument("name", choices=sorted(BENCHMARKS))
    parser.add_argument("--minutes", type=float, help="of page-open (default: 10)")
    parser.add_argument("--times", type=int, help="of crash (default: 50)")
    options, others = parser.parse_known_args()
    if options.name == "tracking" and others:
        print(resolve_name("tracking:main")(others))
        return
    if others:
        parser.error(f"unknown arguments: {' '.join(others)}")
    arguments = {"page-open": options.minutes or 10.0, "crash": options.times or 50}
    given = [arguments[options.name]] if options.name in arguments else []
    table = resolve_name(BENCHMARKS[options.name])(*given)
    print(table)
    write(options.name, table)


if __name__ == "__main__":
    main()
