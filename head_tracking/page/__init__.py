"""The page of one robot in a browser: a server, its live data, and JavaScript parts of its own."""
