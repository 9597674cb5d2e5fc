"""What is made of a result for people: a verdict, wall thickness, a report page, the history of runs."""
