"""Two streams → pairs at one instant: the only place that matches instants.

Both describe one attitude; each pair comes with the bound of its own error. Limits and alarms are not known here.
"""
