"""The published campaign of 18 stacks: tables, pictures, screening of effects, verdict."""
