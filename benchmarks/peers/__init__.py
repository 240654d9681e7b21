"""gcs-bridge beside other readers of recordings, each in an environment of its own: `python -m benchmarks.peers`."""
