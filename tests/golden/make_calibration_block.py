"""calibration_block.json -> calibration_block.hex: the block that tools and firmware must read alike."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tools"))

from wineglass import calibration_block  # noqa: E402


def main() -> None:
    digits = calibration_block.to_binary(calibration_block.read_json(HERE / "calibration_block.json")).hex()
    lines = [digits[at:at + 64] for at in range(0, len(digits), 64)]
    (HERE / "calibration_block.hex").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
