"""Teaching by touch: an arm is guided by its skin, a tap ends the lesson, and the arm repeats it."""
