"""System packages: found by what they provide, installed where that is allowed, else named in one line."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

from wineglass.launch.notice import Notice, SetupError, run_logged, tail
from wineglass.launch.pythons import find_python

CMAKE_MINIMUM = (3, 25)


def require(root: Path, notice: Notice) -> None:
    """Installs what is missing, or stops with the one line that the user has to run."""
    packages = missing()
    if not packages:
        return
    if not may_install():
        raise SetupError(f"system packages are missing; run this line, then repeat the command: {install_line(packages)}"
                         + ("  (python3 must be at least 3.11)" if "python3" in packages else ""), 2)
    notice.say(f"installing system packages: {' '.join(packages)}")
    log = root / "build" / "setup-packages.log"
    if not install(packages, log):
        raise SetupError(f"the package installation failed; run it by hand: {install_line(packages)}\n{tail(log)}", 2)
    still = missing()
    if still:
        raise SetupError(f"still missing after the installation: {' '.join(still)} (cmake must be at least "
                         f"{'.'.join(map(str, CMAKE_MINIMUM))}, python3 at least 3.11)", 2)


def missing() -> list[str]:
    """Debian package names that would provide what is absent."""
    packages = []
    if not _compiler_works():
        packages += ["gcc", "libc6-dev"]
    if not _cmake_is_new_enough():
        packages.append("cmake")
    if not (shutil.which("ninja") or shutil.which("make")):
        packages.append("ninja-build")
    if not shutil.which("git"):
        packages.append("git")
    if find_python() is None:
        packages += ["python3", "python3-venv"]
    return packages


def may_install() -> bool:
    """A Debian-like system, and root or sudo without a password."""
    if not _is_debian_like() or not shutil.which("apt-get"):
        return False
    return os.geteuid() == 0 or _sudo_works()


def install(packages: list[str], log: Path) -> bool:
    prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
    apt = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-o", "DPkg::Lock::Timeout=300"]
    run_logged([*apt, "update"], log)  # a partly failing update may still do: the next line decides
    return run_logged([*apt, "install", "-y", "--no-install-recommends", *packages], log) == 0


def install_line(packages: list[str]) -> str:
    names = " ".join(packages)
    if _is_debian_like():
        sudo = "" if os.geteuid() == 0 else "sudo "
        return f"{sudo}apt-get update && {sudo}apt-get install -y --no-install-recommends {names}"
    return f"install with your system's package manager what Debian calls: {names}"


def _is_debian_like() -> bool:
    try:
        text = Path("/etc/os-release").read_text(encoding="utf-8")
    except OSError:
        return False
    return bool(re.search(r"^(ID|ID_LIKE)=.*\b(debian|ubuntu)\b", text, re.MULTILINE))


def _sudo_works() -> bool:
    return bool(shutil.which("sudo")) and _succeeds(["sudo", "-n", "true"])


def _compiler_works() -> bool:
    """A C compiler and the C library's headers."""
    compiler = os.environ.get("CC") or "cc"
    command = [*compiler.split(), "-E", "-x", "c", "-"]
    return bool(shutil.which(command[0])) and _succeeds(command, "#include <stdio.h>\n")


def _cmake_is_new_enough() -> bool:
    if not shutil.which("cmake"):
        return False
    answer = subprocess.run(["cmake", "--version"], capture_output=True, text=True, check=False)
    version = re.search(r"(\d+)\.(\d+)", answer.stdout)
    return bool(version) and tuple(map(int, version.groups())) >= CMAKE_MINIMUM


def _succeeds(command: list[str], text: str = "") -> bool:
    return subprocess.run(command, input=text.encode(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                          check=False).returncode == 0
