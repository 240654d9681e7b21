"""Live links: the only sockets and serial ports, and the loop that listens to them.

What its bytes mean is not known here, and a link writes nothing by itself.
"""
