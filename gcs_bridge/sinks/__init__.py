"""Where frames and events go while a link is listened to: files and the console."""
