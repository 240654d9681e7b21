"""What is left of an alarm to look at: a folder of its own with its data, its frames, a summary and a picture.

`Place` is where it goes, `Evidence` gathers it while a recording is judged. docs/evidence.md says what the files hold.
How anything was judged is not known here: an observer is shown it.
"""
