"""Touch behaviours (Fig. 2, L4), each a subclass of `Capability`.

The withdrawal reflex responds to the force and place of a touch (eqs 5-7). Other capabilities yield to a
touch, stop the robot, play gestures, or combine behaviours in a tree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.capabilities.arbiter import Arbiter as Arbiter
    from tci.capabilities.arbiter import ArbiterMemory as ArbiterMemory
    from tci.capabilities.attend.capability import Attend as Attend
    from tci.capabilities.attend.capability import Attention as Attention
    from tci.capabilities.body_withdrawal import BodyWithdrawal as BodyWithdrawal
    from tci.capabilities.capability import Capability as Capability
    from tci.capabilities.capability import lacks as lacks
    from tci.capabilities.companion import Companion as Companion
    from tci.capabilities.contact_stop import ContactStop as ContactStop
    from tci.capabilities.contact_stop import StopMemory as StopMemory
    from tci.capabilities.fields import BodyField as BodyField
    from tci.capabilities.fields import BodyFields as BodyFields
    from tci.capabilities.fields import BodyMotion as BodyMotion
    from tci.capabilities.fields import ForceRange as ForceRange
    from tci.capabilities.fields import ReceptiveField as ReceptiveField
    from tci.capabilities.fields import default_fields as default_fields
    from tci.capabilities.fields import load_fields as load_fields
    from tci.capabilities.finger_reflex.capability import FingerMemory as FingerMemory
    from tci.capabilities.finger_reflex.capability import FingerReflex as FingerReflex
    from tci.capabilities.finger_reflex.capability import LetGo as LetGo
    from tci.capabilities.gentle.capability import Gentle as Gentle
    from tci.capabilities.gentle.capability import GentleMemory as GentleMemory
    from tci.capabilities.in_counts import InCounts as InCounts
    from tci.capabilities.layer import Layer as Layer
    from tci.capabilities.light_grasp import Grip as Grip
    from tci.capabilities.light_grasp import LightGrasp as LightGrasp
    from tci.capabilities.needs import Need as Need
    from tci.capabilities.play_gesture import GestureMemory as GestureMemory
    from tci.capabilities.play_gesture import Phase as Phase
    from tci.capabilities.play_gesture import PlayGesture as PlayGesture
    from tci.capabilities.soft_hands import SoftArm as SoftArm
    from tci.capabilities.soft_hands import SoftHands as SoftHands
    from tci.capabilities.soft_reaction import Posture as Posture
    from tci.capabilities.soft_reaction import SoftReaction as SoftReaction
    from tci.capabilities.sway import Sway as Sway
    from tci.capabilities.sway import SwayMemory as SwayMemory
    from tci.capabilities.teach.capability import Taught as Taught
    from tci.capabilities.teach.capability import Teach as Teach
    from tci.capabilities.teach.guide import Feel as Feel
    from tci.capabilities.teach.motion import Correction as Correction
    from tci.capabilities.teach.motion import Motion as Motion
    from tci.capabilities.touch_words.capability import Heard as Heard
    from tci.capabilities.touch_words.capability import TouchWord as TouchWord
    from tci.capabilities.touch_words.capability import TouchWords as TouchWords
    from tci.capabilities.withdrawal import Answer as Answer
    from tci.capabilities.withdrawal import WithdrawalReflex as WithdrawalReflex
    from tci.capabilities.withdrawal_memory import Response as Response
    from tci.capabilities.withdrawal_memory import Withdrawals as Withdrawals
    from tci.capabilities.wrapper import CapabilityWrapper as CapabilityWrapper
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
