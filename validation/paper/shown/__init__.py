"""The paper beside our results, as text, figures and a page: all that draws or prints."""
