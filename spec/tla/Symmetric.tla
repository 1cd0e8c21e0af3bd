------------------------------ MODULE Symmetric ------------------------------
(***************************************************************************)
(* System with interchangeable stations: those that only prescribe among   *)
(* themselves, and those that receive among themselves (so if each may do  *)
(* either, all).  Ids are model values here.  For safety only.             *)
(***************************************************************************)
EXTENDS System, TLC

ASSUME Prescribers \cap Receivers = {} \/ Prescribers = Receivers
ASSUME Restarters = {}

Symmetry ==
  {f @@ g : f \in Permutations(Prescribers \ Receivers),
            g \in Permutations(Receivers)}
==============================================================================
