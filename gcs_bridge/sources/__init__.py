"""The only sockets and serial ports: live links, opened by pymavlink and read by us. Nothing is ever sent."""
