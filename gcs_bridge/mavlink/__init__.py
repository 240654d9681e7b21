"""MAVLink on the wire: dialect tables, frame scan, decode.

Bytes in, records out. No I/O, no clock, and no vehicle is known here.
"""
