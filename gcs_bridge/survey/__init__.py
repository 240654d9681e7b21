"""Thousands of recordings judged, on this machine or a cluster: a Parquet dataset, and a summary of it.

found: which recordings there are, in folders and at URLs · task: what a worker does with one · rows: what is kept of
its report · **dataset**: where that is kept, so that nothing is judged twice · parts: its files · run: all of it, with
failures tried again · summary, drift: what the dataset says of the fleet · page, text: how that reads.
"""
