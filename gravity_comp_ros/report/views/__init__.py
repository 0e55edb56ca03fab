"""One view a file: each turns contents into a titled part of the page."""
