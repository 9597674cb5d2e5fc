"""The command line: main.py reads the words, commands.py does them."""
