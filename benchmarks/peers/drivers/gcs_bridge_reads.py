"""gcs-bridge reads a recording into arrays, all of it; some are counted."""

import sys

import gcs_bridge

path, *names = sys.argv[1:]
vehicles = gcs_bridge.read(path).vehicles.values()
print(*(f"{name}={sum(len(getattr(vehicle, name.lower())) for vehicle in vehicles)}" for name in names))
