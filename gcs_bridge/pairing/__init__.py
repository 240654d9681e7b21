"""Two sampled descriptions of one attitude → pairs at one instant: the only place that matches instants."""
