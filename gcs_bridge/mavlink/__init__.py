"""MAVLink on the wire: dialect tables, frame scan, decode. Bytes in, records out; no I/O, no clock, no vehicle."""
