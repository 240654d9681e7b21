"""Say which gcs-bridge this Python has, and what else its speed hangs on."""

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import gcs_bridge

origin = "installed from a wheel" if "site-packages" in Path(gcs_bridge.__file__).parts else "a checkout"
libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
scipy = "SciPy is installed beside it" if find_spec("scipy") else "no SciPy"
print(f"gcs-bridge {gcs_bridge.__version__}, {origin}: {libraries}, {scipy}")
