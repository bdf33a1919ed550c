"""From files to one resolved document: scenes, mechanisms, their places and shapes."""
