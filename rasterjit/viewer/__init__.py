"""The viewer: events in, pictures out, in a window, a page, a notebook or a terminal."""
