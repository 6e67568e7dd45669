"""Whether the FMUs have the pointing indices that linear theory says, within what is stated of their confidence."""
