"""Print the table that walker.c is compiled with: of each message's id the checksum's extra byte, from pymavlink.

`python crc_extras.py NAME ...`: the messages that are to be counted.
"""

import sys

from pymavlink.dialects.v20 import all as mavlink

known = sorted((message.id, message.crc_extra) for message in mavlink.mavlink_map.values())
print("static const struct { uint32_t id; uint8_t crc_extra; } KNOWN[] = {")
print("\n".join(f"    {{{number}, {extra}}}," for number, extra in known))
print("};\nstatic const struct { uint32_t id; const char *name; } COUNTED[] = {")
print("\n".join(f'    {{{getattr(mavlink, f"MAVLINK_MSG_ID_{name}")}, "{name}"}},' for name in sys.argv[1:]))
print("};")
