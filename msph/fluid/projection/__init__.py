"""The projection method: incompressible, momentum-conserving SPH over layers of any size."""
