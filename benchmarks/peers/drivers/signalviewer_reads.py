"""signalviewer reads a recording into signals, all of it: it has no choice of messages. Some are counted.

A signal is a field of a message: "ATTITUDE.roll [rad]", or "RAW_IMU[0].xacc" of the instance 0.
"""

import sys

import signalviewer  # type: ignore[import-not-found]

path, *names = sys.argv[1:]
recording = signalviewer.load(path)
one_of_each = {signal.split(".")[0]: signal for signal in recording.signals}
counts = dict.fromkeys(names, 0)
for message, signal in one_of_each.items():
    name = message.split("[")[0]
    if name in counts:
        counts[name] += len(recording.signal(signal)[1])
print(*(f"{name}={count}" for name, count in counts.items()))
