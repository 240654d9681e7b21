"""Live links: the only sockets and serial ports, and the loop that listens to them."""
