"""Measurements beside other tools, and of what the bridge can be trusted with; run from the top of a checkout."""
