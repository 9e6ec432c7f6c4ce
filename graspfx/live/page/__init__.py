"""Page of a recording, of a scene that the page runs, or of a live run: data, scenery and script in one document."""
