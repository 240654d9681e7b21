"""When what was measured becomes an alarm, and what is told of it; nothing is measured here."""
