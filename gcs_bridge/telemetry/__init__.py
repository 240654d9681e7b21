"""From a link's frames to one vehicle's samples: its clocks, identity, streams, statements. Nothing is judged here."""
