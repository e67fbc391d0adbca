"""seal_image.py OBJCOPY IMAGE.elf: sets the CRC-32 of the program into its seal and writes IMAGE.hex and IMAGE.bin."""

import subprocess
import sys
import tempfile
import zlib
from pathlib import Path


def main(objcopy: str, image: Path) -> None:
    def run(*words: object) -> None:
        subprocess.run([objcopy, *map(str, words)], check=True)

    with tempfile.TemporaryDirectory() as folder:
        program, seal = Path(folder) / "program.bin", Path(folder) / "seal.bin"
        run("-O", "binary", "--remove-section", ".seal", image, program)
        seal.write_bytes(zlib.crc32(program.read_bytes()).to_bytes(4, "little"))
        run("--update-section", f".seal={seal}", image)
    run("-O", "ihex", image, image.with_suffix(".hex"))
    run("-O", "binary", image, image.with_suffix(".bin"))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
