"""What of this machine matters to who listens: kernels, viewer, importer, groups, ModemManager. Nothing is changed."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from importlib import import_module, metadata
from pathlib import Path

from gcs_bridge import cache
from gcs_bridge.errors import INCOMPATIBLE
from gcs_bridge.inspection.schema import MachinePart

__all__ = ["machine"]
_IMPORTER = "rerun-importer-tlog"
_PATIENCE_S = 10.0  # for a program to end that has nothing to do
_GROUPS = ("dialout", "uucp")  # whose members may use serial devices, by distribution


def machine() -> dict[str, MachinePart]:
    """Each part by its name; what cannot be looked at is unknown, and no reason to fail."""
    return {name: _looked_at(look) for name, look in _PARTS.items()}


def _looked_at(look: Callable[[], MachinePart]) -> MachinePart:
    try:
        return look()
    except (OSError, ImportError, subprocess.TimeoutExpired, metadata.PackageNotFoundError) as error:
        return MachinePart(state="unknown", text=f"cannot be looked at: {error}")


def _python() -> MachinePart:
    text = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return MachinePart(state="good", text=f"{text}, pymavlink {metadata.version('pymavlink')}")


def _kernels() -> MachinePart:
    """Those of all that judges; each is compiled once on a machine."""
    from gcs_bridge.jit.kernels import KERNELS

    import_module("gcs_bridge.judging.monitor")  # with it every module that has a kernel
    ready, all_of_them = sum(one.is_ready for one in KERNELS), len(KERNELS)
    kept_in = cache.writable()
    if kept_in is None:
        text = "compiled anew by every process: no folder can be written to keep them in"
        return MachinePart(state="mend", text=text, command="export GCS_BRIDGE_CACHE_DIR=~/.cache/gcs-bridge")
    text = f"{ready} of {all_of_them} are compiled, and kept in {kept_in}"
    if ready == all_of_them:
        return MachinePart(state="good", text=text)
    text += "; the next run compiles the others, which takes up to half a minute"
    return MachinePart(state="mend", text=text, command="gcs-bridge demo --viewer none --duration 3")


def _viewer() -> MachinePart:
    from gcs_bridge.viewer.open import has_display, is_installed

    if not is_installed():
        again = f"{Path(sys.executable).name} -m pip install rerun-sdk"
        return MachinePart(state="mend", text="rerun is not installed", command=again)
    shown = "a window opens" if has_display() else "no display here: a page for the browser is served"
    return MachinePart(state="good", text=f"rerun {metadata.version('rerun-sdk')}; {shown}")


def _importer() -> MachinePart:
    """By which rerun's own viewer opens recordings: it looks for it among the programs, and so is it tried here."""
    found = shutil.which(_IMPORTER)
    if found is None:
        folder = Path(sysconfig.get_path("scripts"))
        if shutil.which(_IMPORTER, path=folder) is None:
            again = f"{Path(sys.executable).name} -m pip install --force-reinstall --no-deps gcs-bridge"
            return MachinePart(state="mend", text=f"{_IMPORTER} is not installed", command=again)
        text = f"{_IMPORTER} is not among the programs of PATH, where rerun looks for it"
        return MachinePart(state="mend", text=text, command=f'export PATH="{folder}:$PATH"')
    asked = [found, os.devnull]
    tried = subprocess.run(asked, capture_output=True, timeout=_PATIENCE_S, check=False)  # noqa: S603  # our own program
    if (code := tried.returncode) != INCOMPATIBLE:
        text = f"{found} does not work (exit code {code}): it may be another version's"
        return MachinePart(state="mend", text=text, command=f"{found} {os.devnull}")
    return MachinePart(state="good", text=f"{_IMPORTER} is {found}: rerun opens recordings by themselves")


def _groups() -> MachinePart:
    """Whether this user may use serial devices."""
    if os.name != "posix" or sys.platform == "darwin":
        return MachinePart(state="good", text="serial devices need no group here")
    import grp

    from gcs_bridge.links.open import device_group, serial_devices

    devices = serial_devices()
    known = {group.gr_name: group.gr_gid for group in grp.getgrall()}
    usual = next((name for name in _GROUPS if name in known), None)
    needed = {device_group(device) for device in devices} or ({usual} if usual else set())
    there = f"serial devices: {', '.join(devices)}" if devices else "no serial device is there"
    if os.geteuid() == 0:
        return MachinePart(state="good", text=f"{there}; this is root, who may use all of them")
    mine = {*os.getgroups(), os.getegid()}
    lacking = sorted(name for name in needed if known.get(name, -1) not in mine)
    if not lacking:
        return MachinePart(state="good", text=f"{there}; this user is in {' and '.join(sorted(needed)) or 'no group'}")
    join = f"sudo usermod -aG {','.join(lacking)} $USER"
    text = f"{there}; this user is not in {' and '.join(lacking)}, and may not use them: join, then log in again"
    return MachinePart(state="mend", text=text, command=join)


def _modem_manager() -> MachinePart:
    from gcs_bridge.links.open import MODEM_MANAGER
    from gcs_bridge.links.port_owner import is_running

    if sys.platform != "linux":
        return MachinePart(state="absent", text=f"there is no {MODEM_MANAGER} here")
    if not is_running(MODEM_MANAGER):
        return MachinePart(state="good", text="does not run")
    text = "runs: it takes each new serial device for a modem, and holds it for some seconds"
    return MachinePart(state="mend", text=text, command=f"sudo systemctl disable --now {MODEM_MANAGER}")


_PARTS: dict[str, Callable[[], MachinePart]] = {
    "python": _python,
    "kernels": _kernels,
    "viewer": _viewer,
    "importer": _importer,
    "groups": _groups,
    "modem_manager": _modem_manager,
}
