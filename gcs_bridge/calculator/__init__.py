"""One attitude in every form and frame, and what each common mistake would make of it.

A page as a dict, and as text; no vehicle, no time and no terminal is known here.
"""
