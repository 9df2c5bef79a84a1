"""Robot skin of TCI as a force sensor for mjlab. Needs neither TCI nor its MuJoCo."""

from mjlab_tci.sensor import SkinSensor as SkinSensor
from mjlab_tci.sensor import SkinSensorCfg as SkinSensorCfg
from mjlab_tci.skin import G1 as G1
from mjlab_tci.skin import Patch as Patch
from mjlab_tci.skin import read_skin as read_skin
