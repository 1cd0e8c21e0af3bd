------------------------- MODULE RefinementAblations -------------------------
(***************************************************************************)
(* The ablations, with the promise of Coordination.                        *)
(***************************************************************************)
EXTENDS Ablations

Refined == INSTANCE Refinement
PromiseProp == Refined!PromiseProp
==============================================================================
