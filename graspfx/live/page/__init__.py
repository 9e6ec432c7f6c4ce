"""HTML pages that show a recording, a scene that the page itself runs, or a live run."""
