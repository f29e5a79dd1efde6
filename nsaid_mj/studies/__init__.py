"""Many runs: methods compared, fields swept, Monte-Carlo."""
