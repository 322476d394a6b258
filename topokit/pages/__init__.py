"""Self-contained HTML pages: a 3D view, the verdict and the evidence of shapes, for a browser without a network."""

from topokit.pages.document import Entry, write_html
from topokit.pages.fragment import Fragment, page_of

__all__ = ["Entry", "Fragment", "page_of", "write_html"]
