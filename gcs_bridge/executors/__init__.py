"""Work on several cores or machines: each piece of it is a small record, and so is what comes of it.

**base**: what an executor is · here: in this process · processes: on this machine's cores · cluster: on a Dask cluster.
"""
