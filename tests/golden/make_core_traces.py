"""core_traces.c -> core_traces.txt: integer traces of every kernel and of whole gyro runs. Needs a C compiler ($CC, else cc)."""

import os
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


def main() -> None:
    sources = [HERE / "core_traces.c", ROOT / "tests/support/random.c", ROOT / "tests/support/gyro_fixture.c",
               *sorted((ROOT / "firmware/core").glob("*.c"))]
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "core_traces"
        subprocess.run([os.environ.get("CC", "cc"), "-std=c11", "-D_DEFAULT_SOURCE", "-O2", "-ffp-contract=off",
                        "-I", ROOT / "firmware", "-I", ROOT / "tests", "-o", program, *sources, "-lm"], check=True)
        text = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    (HERE / "core_traces.txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
