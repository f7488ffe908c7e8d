"""Views: the data of players and boards, and the pages that show them.

A page is one HTML file without any external request: ``page.html`` with the style and scripts of this folder and, if
available, the data. Without data, the page requests them from the program that shows it (an MCP host).
"""
