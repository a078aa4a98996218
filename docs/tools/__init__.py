"""Extensions of Sphinx for the pages."""
