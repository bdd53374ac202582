from .device.device import Device as Device
from .device.device import choose_device as choose_device
from .device.device import list_devices as list_devices
from .device.device_info import DeviceInfo as DeviceInfo
from .errors import DeviceError as DeviceError
from .errors import InputError as InputError
from .errors import SonarmapError as SonarmapError
from .fft.transform import RealFFT as RealFFT
from .points.voxelize import voxelize as voxelize
from .pomf.peak import Peak as Peak
from .pomf.peak import find_peaks as find_peaks
from .pomf.spectrum import Pomf as Pomf
from .pomf.spectrum import magnitude as magnitude
from .pomf.spectrum import whiten as whiten
from .resample.layers import normalize_layers as normalize_layers
from .resample.layers import polar_magnitude as polar_magnitude
from .resample.layers import rectangular_unwrap as rectangular_unwrap
from .resample.layers import rotational_unwrap as rotational_unwrap
from .resample.layers import sample as sample
from .resample.layers import upload_directions as upload_directions
from .so3.correlation import RotationCorrelation as RotationCorrelation
from .so3.harmonics import Harmonics as Harmonics
from .so3.harmonics import equalizers as equalizers

__all__ = [
    "Device",
    "DeviceError",
    "DeviceInfo",
    "Harmonics",
    "InputError",
    "Peak",
    "Pomf",
    "RealFFT",
    "RotationCorrelation",
    "SonarmapError",
    "choose_device",
    "equalizers",
    "find_peaks",
    "list_devices",
    "magnitude",
    "normalize_layers",
    "polar_magnitude",
    "rectangular_unwrap",
    "rotational_unwrap",
    "sample",
    "upload_directions",
    "voxelize",
    "whiten",
]
