"""python -m wineglass.checks.twin_library: builds the twin library as the launcher does before a command that uses it."""

from __future__ import annotations

import sys

from wineglass.launch import build
from wineglass.launch.notice import Notice, SetupError
from wineglass.launch.single import only_one
from wineglass.paths import repository_root


def main() -> int:
    root, notice = repository_root(), Notice()
    try:
        with only_one(root, notice):
            if not build.is_fresh(root):
                build.make(root, notice)
    except SetupError as error:
        print(f"wineglass: error: {error}", file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
