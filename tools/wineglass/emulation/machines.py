"""The machines on which the firmware can be run here, and what each one needs."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from wineglass import paths
from wineglass.errors import WineglassError
from wineglass.launch import build

PROGRAM = "wineglass_stream"


@dataclass(frozen=True)
class Machine:
    preset: str
    """also the build folder's name"""
    what: str
    compiler: str
    emulator: tuple[str, ...]
    """command in front of (user mode) or around (board) the program; `{program}` stands for its path"""
    packages: tuple[str, ...]

    def program(self, name: str = PROGRAM) -> Path:
        return paths.build_folder(self.preset) / "bin" / name

    def command(self, name: str = PROGRAM, options: tuple[str, ...] = ()) -> list[str]:
        """Command line that runs a program of this machine; `options` go to the emulator."""
        words = [word.replace("{program}", str(self.program(name))) for word in self.emulator]
        return [words[0], *options, *words[1:]]

    @property
    def tools(self) -> tuple[str, str]:
        """Programs that it takes."""
        return self.compiler, self.emulator[0]

    def missing(self) -> list[str]:
        """Those that are not installed."""
        return [tool for tool in self.tools if not shutil.which(tool)]

    def build(self, emulated: bool = True) -> None:
        """Configures and builds all programs of this machine; quick when nothing has changed. Its emulator must be there, too, unless
        it is not to be `emulated`."""
        root, log = paths.repository_root(), paths.repository_root() / "build" / f"{self.preset}.log"
        missing = [tool for tool in self.missing() if emulated or tool == self.compiler]
        if missing:
            raise WineglassError(f"{self.preset}: {' and '.join(missing)} not installed; "
                                 f"apt-get install --no-install-recommends {' '.join(self.packages)}")
        variables = build.prepare(root, self.preset)
        log.parent.mkdir(exist_ok=True)
        with open(log, "wb") as stream:
            for command in (["cmake", "--preset", self.preset],
                            ["cmake", "--build", "--preset", self.preset, "--parallel", str(os.cpu_count() or 1)]):
                done = subprocess.run(command, cwd=root, env=variables, stdout=stream, stderr=subprocess.STDOUT, check=False)
                if done.returncode != 0:
                    raise WineglassError(f"{self.preset}: the build failed; see {log}")


def _board(name: str, what: str) -> Machine:
    emulator = ("qemu-system-arm", "-M", name, "-display", "none", "-monitor", "none", "-serial", "none",
                "-semihosting-config", "enable=on,target=native", "-kernel", "{program}")
    return Machine(name, what, "arm-none-eabi-gcc", emulator,
                   ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm"))


def _user(name: str, what: str, prefix: str, emulator: str, libc: str) -> Machine:
    return Machine(f"user-{name}", what, f"{prefix}-gcc", (emulator, "-L", f"/usr/{prefix}", "{program}"),
                   (f"gcc-{prefix}", f"libc6-dev-{libc}-cross", "qemu-user"))


M4 = _board("mps2-an386", "Cortex-M4")
BOARDS = (M4, _board("mps2-an500", "Cortex-M7"))
USERS = (
    _user("armhf", "32-bit ARM", "arm-linux-gnueabihf", "qemu-arm", "armhf"),
    _user("arm64", "64-bit ARM", "aarch64-linux-gnu", "qemu-aarch64", "arm64"),
    _user("riscv64", "64-bit RISC-V", "riscv64-linux-gnu", "qemu-riscv64", "riscv64"),
    _user("s390x", "64-bit z/Architecture, big-endian", "s390x-linux-gnu", "qemu-s390x", "s390x"),
    _user("i386", "32-bit x86", "i686-linux-gnu", "qemu-i386", "i386"),
)
MACHINES = BOARDS + USERS

# The board's own image, on an emulated board that lacks clocks, DMA and flash: not the device behind a stream, but all of it.
# Its serial line is the character device `line`, which the caller describes.
STM32F405 = Machine("stm32f405", "STM32F405", "arm-none-eabi-gcc",
                    ("qemu-system-arm", "-M", "netduinoplus2", "-display", "none", "-monitor", "none", "-no-reboot",
                     "-serial", "chardev:line", "-kernel", "{program}"), BOARDS[0].packages)
