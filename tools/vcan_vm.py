"""Run the tests marked `vcan`: on this kernel where it has vcan, else inside a small virtual machine.

The machine boots a Debian kernel that is unpacked from its package, not installed, and sees this computer's files
read-only. Exit code: pytest's; 77 when the tests could not run here, after one line that says how to get them; with
HIL_BRIDGE_REQUIRE_VCAN set that is an error, 1. What else is on the command line is handed to pytest.
"""

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
CACHE = Path(sys.prefix) / "cache" / "vcan-kernel"
"""Within the environment, which is not under version control."""

SKIPPED = 77
"""Exit code of a step that could not run here."""
REQUIRE = "HIL_BRIDGE_REQUIRE_VCAN"
SECONDS = "HIL_BRIDGE_VCAN_SECONDS"

PACKAGES = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "modprobe": "kmod",
    "zstd": "zstd",
    "ip": "iproute2",
    "candump": "can-utils",
}
"""Commands that the machine needs, and the Debian packages that have them."""
KERNEL = "linux-image-amd64"
"""Names the newest kernel; the one for clouds has no CAN."""

KVM_PATIENCE_S = 10.0
"""Until a machine with KVM must be up, else it is emulated: on some nested machines KVM hangs."""
PATIENCE_S = 600.0
"""Longest wait for everything beside the fast stream. Chosen: four times what it takes emulated."""
STREAM_PATIENCE = 20.0
"""And for each second of that. Chosen: four times what it takes emulated."""
POLL_S = 0.2
INSTRUCTION_TIME = " -icount shift=0"
"""The emulated computer's clock goes by its instructions, 1 ns each, as long as it has something to do.

So it is always a computer of 1 GIPS to its programs, however slow it is emulated. Programs that need real time work
there, and a busy host makes it longer, never late.
"""

SYSTEM_FOLDERS = "/usr/sbin:/sbin"
"""Folders in which Debian keeps commands that a person's PATH lacks."""


class Unavailable(Exception):
    """The machine cannot be had here; the text says why, in a part of a line."""


def which(command: str) -> str | None:
    """Where a command is, for a person's PATH too."""
    return shutil.which(command, path=f"{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}")


def pytest_command(arguments: Sequence[str]) -> list[str]:
    """Command that runs the tests, here and inside, where nothing can be written to the checkout."""
    return [
        *(sys.executable, "-m", "pytest", "tests/vcan", "-m", "vcan"),
        *("-p", "no:cacheprovider", "-p", "no:hypothesispytest"),
        *("--timeout", "240", "--durations", "0", "--durations-min", "1", *arguments),
    ]


# --- on this kernel


def direct() -> list[str] | None:
    """Prefix of a command that may then create vcan interfaces, or None where that cannot be."""
    ip = which("ip")
    if ip is None:
        return None
    unshare = which("unshare")
    # a user may do it in a network namespace of its own, where the kernel lets users have one
    for before in ([], [unshare, "--user", "--map-root-user", "--net"] if unshare else []):
        name = f"vcan{os.getpid()}"
        script = f"{ip} link add dev {name} type vcan && {ip} link delete dev {name}"
        if subprocess.run([*before, "sh", "-c", script], capture_output=True, check=False).returncode == 0:
            return before
    return None


# --- in a machine


def unpacked_kernel() -> Path:
    """The kernel's image, with its modules where the package has them. Raises Unavailable."""
    if not (images := sorted(CACHE.glob("boot/vmlinuz-*"))):
        _unpack()
        images = sorted(CACHE.glob("boot/vmlinuz-*"))
    if not images:
        raise Unavailable(f"the package of the kernel has no image; delete {CACHE}")
    return images[-1]


def _unpack() -> None:
    def run(*command: str | Path, cwd: Path) -> str:
        try:
            return subprocess.run(
                command, cwd=cwd, check=True, capture_output=True, text=True, timeout=300
            ).stdout
        except (OSError, subprocess.SubprocessError) as error:
            said = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
            raise Unavailable(f"{command[0]} cannot get a Debian kernel ({said})") from error

    CACHE.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=CACHE.parent, prefix="unpacking-") as name:
        place = Path(name)
        depends = run("apt-cache", "depends", KERNEL, cwd=place)
        real = re.search(r"Depends: (linux-image-\S+)", depends)
        if real is None:
            raise Unavailable(f"apt knows no package {KERNEL}; this needs Debian")
        print(f"vcan: downloading {real[1]}, once", flush=True)
        run("apt-get", "download", real[1], cwd=place)
        (package,) = place.glob("*.deb")
        run("dpkg-deb", "--extract", package, place / "kernel", cwd=place)
        (modules,) = place.glob("kernel/lib/modules/*")
        run(which("depmod") or "depmod", "--basedir", place / "kernel", modules.name, cwd=place)
        shutil.rmtree(CACHE, ignore_errors=True)
        (place / "kernel").rename(CACHE)


def guest_script(share: Path, command: Sequence[str], settings: dict[str, str]) -> str:
    """Script of the machine: its results are files, since its console drops characters.

    Python and the checkout are mounted a second time, with a cache, over where they are. Without one every start of
    Python reads all of its files through the emulated disk again.
    """
    host = "/run/host"
    cached = {str(Path(sys.base_prefix).resolve()), str(Path(sys.prefix).resolve()), str(ROOT)}
    # a file of the machine's own lies beneath none of them
    binds = [f"mount --bind {host}{shlex.quote(folder)} {shlex.quote(folder)}" for folder in sorted(cached)]
    exports = [f"export {name}={shlex.quote(value)}" for name, value in settings.items()]
    return "\n".join(
        (
            "#!/bin/sh",
            f"cd {shlex.quote(str(share))}",
            "exec > output 2>&1",
            "touch up",
            "modprobe vcan; modprobe can-raw",
            f"mkdir -p {host}",
            f"mount -t 9p -o ro,trans=virtio,version=9p2000.L,cache=loose,msize=512000 cached {host}",
            *binds,
            *exports,
            f"cd {shlex.quote(str(ROOT))}",
            shlex.join(command),
            f"echo $? > {shlex.quote(str(share))}/code",
        )
    )


def machine_command(image: Path, share: Path, kvm: bool) -> list[str]:
    """Boot with the computer's files read-only and `share` to write to."""
    cached = (
        " -fsdev local,id=cached,path=/,security_model=none,readonly=on,multidevs=remap"
        " -device virtio-9p-pci,fsdev=cached,mount_tag=cached"
    )
    return [
        *(str(BIN / "vng"), "--run", str(image), "--force-9p", "--disable-microvm", "--verbose"),
        *([] if kvm else ["--disable-kvm"]),
        *("--cpus", "2" if kvm else "1", "--memory", "2G", "--rwdir", str(share)),
        f"--qemu-opts={cached}{'' if kvm else INSTRUCTION_TIME}",
        *("--exec", f"sh {share}/guest.sh"),
    ]


def run_machine(
    image: Path, command: Sequence[str], settings: dict[str, str], limit: float, kvm: bool
) -> int:
    """Boot once, show pytest's output as it comes, and return its exit code.

    Raises Unavailable when a machine with KVM does not come up, TimeoutError for one that does not end.
    """
    with tempfile.TemporaryDirectory(prefix="hil-bridge-vcan-") as name:
        share = Path(name)
        output, code, console = share / "output", share / "code", share / "console"
        (share / "guest.sh").write_text(guest_script(share, command, settings))
        output.touch()
        began = time.monotonic()
        with console.open("wb") as log, output.open("rb") as text:
            process = subprocess.Popen(
                machine_command(image, share, kvm),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PATH": f"{BIN}:{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}"},
                start_new_session=True,
            )
            try:
                while True:
                    ended = process.poll() is not None
                    sys.stdout.buffer.write(text.read())
                    sys.stdout.flush()
                    if code.exists() and (said := code.read_text().strip()):
                        return int(said)
                    waited = time.monotonic() - began
                    up = (share / "up").exists()
                    if kvm and not up and (ended or waited > KVM_PATIENCE_S):
                        raise Unavailable("KVM does not come up")
                    if ended or waited > limit:
                        how = "ended without a result" if ended else f"did not end within {limit:.0f} s"
                        last = console.read_text(errors="replace").splitlines()[-15:]
                        raise TimeoutError("\n".join((*last, f"vcan: the virtual machine {how}")))
                    time.sleep(POLL_S)
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def in_machine(arguments: Sequence[str], seconds: float) -> int:
    """Run the tests in a machine. Raises Unavailable where there can be none."""
    missing = [package for command, package in PACKAGES.items() if which(command) is None]
    if missing:
        raise Unavailable(f"a virtual machine needs `apt-get install {' '.join(missing)}`")
    if not (BIN / "vng").exists():
        raise Unavailable(f"a virtual machine needs `{sys.executable} -m pip install virtme-ng`")
    image = unpacked_kernel()
    settings = {
        "PATH": f"{BIN}:{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}",
        "HOME": "/tmp",
        "PYTHONDONTWRITEBYTECODE": "1",
        REQUIRE: "1",
        SECONDS: f"{seconds:g}",
    }
    command = pytest_command(arguments)
    limit = PATIENCE_S + STREAM_PATIENCE * seconds
    for kvm in (True, False):
        if kvm and not os.access("/dev/kvm", os.R_OK | os.W_OK):
            continue
        try:
            return run_machine(image, command, settings, limit, kvm)
        except Unavailable as error:
            print(f"vcan: {error}; emulated instead", flush=True)
        except TimeoutError as error:
            print(error)
            return 1
    return 1


def main() -> int:
    """Run the tests where they can be run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of the 1 kHz stream (default: 3)")
    options, arguments = parser.parse_known_args()
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # so that no machine stays behind
    if (before := direct()) is not None:
        environment = {**os.environ, SECONDS: f"{options.seconds:g}", REQUIRE: "1"}
        return subprocess.run(
            [*before, *pytest_command(arguments)], cwd=ROOT, env=environment, check=False
        ).returncode
    try:
        return in_machine(arguments, options.seconds)
    except Unavailable as error:
        required = bool(os.environ.get(REQUIRE))
        what = "cannot run" if required else "are skipped"
        print(f"vcan tests {what}: this kernel gives no vcan (as root: `modprobe vcan`), and {error}")
        return 1 if required else SKIPPED


if __name__ == "__main__":
    sys.exit(main())
