"""Live links: the only sockets and serial ports, and the loop that listens to them.

Nothing is ever written to a link, and what its bytes mean is not known here.
"""
