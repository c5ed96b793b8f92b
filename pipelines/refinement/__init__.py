"""What `refine-grasps` is made of: contacts found anew, and symmetric copies that hold."""
