"""What a human body is: skeletons, limbs, soles, and from what it does to what its joints do."""
