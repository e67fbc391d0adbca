"""Writes the golden files again: every make_*.py beside this file makes its own."""

import runpy
from pathlib import Path


def main() -> None:
    for maker in sorted(Path(__file__).parent.glob("make_*.py")):
        runpy.run_path(str(maker), run_name="__main__")


if __name__ == "__main__":
    main()
