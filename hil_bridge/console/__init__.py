"""Terminal output: rows, screens and reports of bugs."""
