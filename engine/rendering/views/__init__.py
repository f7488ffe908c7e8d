"""Views: the data of players and boards, and the pages that show them.

A page is one HTML file without any request to elsewhere: ``page.html`` with the style and the scripts of this folder
put in, and the data, where there are any. Without data it asks the program that shows it (an MCP host) for them.
"""
