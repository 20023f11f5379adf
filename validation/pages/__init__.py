"""Pages in HTML: the shell of all pages, the report of a scene, and the page that explores one."""
