"""The report as one HTML file: what it shows (content), how it is written (writer), and the page's own scripts."""
