"""Where frames, samples and events go while links or recordings are judged: files and the console.

A sink takes what it is given; it never asks, and knows no limits.
"""
