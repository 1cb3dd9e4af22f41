"""Chart catalogue of a run: facts, columns, descriptions and marks, which pages and pictures draw."""
