"""Kernels: functions of arrays that are compiled once on a machine, and loaded in a few milliseconds after that.

**kernel** is what Python calls, **helper**, **share** and **in_kernels** say what kernels call · declared: the types of
their arguments · recipe: what machine code depends on · native: how it is loaded · compiler, entry: how it is made, by
numba, which nothing else imports · preparation: all of them at once.
"""

from __future__ import annotations

from gcs_bridge.jit.kernels import helper, in_kernels, inlined, kernel, share
from gcs_bridge.jit.preparation import prepare

__all__ = ["helper", "in_kernels", "inlined", "kernel", "prepare", "share"]
