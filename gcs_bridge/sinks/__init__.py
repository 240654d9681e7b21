"""Where frames, samples and events go while links or recordings are judged: files and the console."""
