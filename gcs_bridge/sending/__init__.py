"""What leaves this program: frames to other ground stations, and to vehicles what was asked for; else not one byte.

What frames mean for a vehicle's attitude is not known here.
"""
