"""What is wrong: a head that has moved or gone blind, a robot that is not where it says."""
