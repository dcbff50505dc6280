"""A run as a page that opens by a double click: nothing to install, no server, no network."""
