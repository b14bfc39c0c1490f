"""The controller's model of the robot: dynamics, vectoring geometry, interference between rotors."""
