"""URDF files written by the tests."""

INERTIA = '<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0.001" ixz="0" iyz="-0.002"/>'


def link(name, mass="1.0", inertia=INERTIA, origin='<origin xyz="0.1 0 0.02"/>', visual=""):
    inertial = f'<inertial>{origin}<mass value="{mass}"/>{inertia}</inertial>' if mass else ""
    return f'<link name="{name}">{inertial}{visual}</link>'


def joint(name, parent, child, kind="revolute", extra="", limits=(-2, 2), xyz="0.3 0 0"):
    low, high = limits
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0.1 -0.2 0.3"/><axis xyz="0 1 0"/>'
        f'<limit effort="30" velocity="2" lower="{low}" upper="{high}"/>{extra}</joint>'
    )


def robot(*parts, name="arm"):
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n' + "\n".join(parts) + "\n</robot>\n"


def chain(links=3, **options):
    """An arm of `links` moving links; options by link number replace its text."""
    parts = [link("base", mass="")]
    for i in range(1, links + 1):
        parts.append(options.get(f"link_{i}", link(f"link_{i}")))
        parent = f"link_{i - 1}" if i > 1 else "base"
        parts.append(options.get(f"joint_{i}", joint(f"joint_{i}", parent, f"link_{i}")))
    return robot(*parts, *options.get("more", ()))
