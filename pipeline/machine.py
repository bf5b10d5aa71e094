"""What this machine can do, asked before work starts."""

from importlib import import_module

from schemas.errors import MachineError


def require_device(device: str) -> None:
    """MachineError where CUDA is asked for and PyTorch finds none."""
    if device == "cuda" and cuda_device() is None:
        raise MachineError(
            "device = 'cuda', but PyTorch finds no GPU here: use --set …device=cpu, or see `pipeline doctor`"
        )


def cuda_device() -> str | None:
    """Name of the GPU PyTorch would use."""
    import torch

    return torch.cuda.get_device_name(0) if torch.cuda.is_available() else None


def require_gl() -> str:
    """Name of the OpenGL renderer; MachineError where there is none."""
    from stages.sim.gl import gl_renderer

    return gl_renderer()


def require_sim() -> None:
    """MachineError where the simulator cannot be imported: MuJoCo loads OpenGL even when nothing is rendered."""
    try:
        import_module("stages.sim.world")
    except (ImportError, AttributeError, OSError) as error:
        raise MachineError(
            f"MuJoCo cannot be loaded ({type(error).__name__}: {error}): see `pipeline doctor`, or set "
            "MUJOCO_GL=disabled where nothing is to be rendered"
        ) from error
