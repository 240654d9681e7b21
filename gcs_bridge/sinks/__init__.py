"""Where frames and events go while a link is listened to: files and the console.

A sink takes what it is given; it never asks, and knows no limits.
"""
